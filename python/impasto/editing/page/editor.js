// Edits marks, outlines of balls or a depth mesh. The server says which, and takes what is saved.
// Places are in pixels of the photograph; whole numbers are the middles of pixels, as in the files.

const byId = (id) => document.getElementById(id);
const view = byId("view"), loupe = byId("loupe"), live = byId("live");
const REACH = 14; // screen pixels within which a pointer takes hold of a mark
const FINE = 0.1, COARSE = 1; // pixels of an arrow key, and with Shift
const PATIENT = 700; // ms within which steps of one key are one change

const doc = await (await fetch("document.json")).json();
const subject = { marks: marksSubject, balls: ballsSubject, mesh: meshSubject }[doc.kind](doc);

// --- changes ------------------------------------------------------------------------------------

let saved = doc.exists ? JSON.stringify(subject.state) : "";
let past = [], future = [], last = { label: "", time: 0 };

/** Apply a change; steps of one label in quick succession are undone together. */
function change(label, made) {
  const before = JSON.stringify(subject.state);
  made();
  if (JSON.stringify(subject.state) === before) return;
  const now = performance.now();
  if (label !== last.label || now - last.time > PATIENT) past.push(before);
  last = { label, time: now };
  future = [];
  refresh();
}

function restore(from, to) {
  if (!from.length) return;
  to.push(JSON.stringify(subject.state));
  subject.state = JSON.parse(from.pop());
  last = { label: "", time: 0 };
  subject.restored?.();
  refresh();
}

async function save() {
  if (byId("save").disabled) return;
  const text = JSON.stringify(subject.state);
  const said = byId("said");
  try {
    const answer = await fetch("save", {
      method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(subject.content()),
    });
    const content = await answer.json();
    said.textContent = answer.ok ? content.said : content.error;
    said.classList.toggle("wrong", !answer.ok);
    if (answer.ok) saved = text;
  } catch {
    said.textContent = "not saved: the command has ended";
    said.classList.add("wrong");
  }
  refresh();
}

addEventListener("beforeunload", (event) => {
  if (past.length && JSON.stringify(subject.state) !== saved) event.preventDefault();
});

// --- photographs --------------------------------------------------------------------------------

let shown = 0; // the photograph
const pictures = new Map(); // by address

function picture(address) {
  if (!pictures.has(address)) {
    if (pictures.size > 200) pictures.clear();
    const image = new Image();
    image.onload = draw;
    image.src = address;
    pictures.set(address, image);
  }
  const image = pictures.get(address);
  return image.complete && image.naturalWidth ? image : null;
}

const size = () => doc.photographs[shown] ?? subject.size;

/** The photograph on a canvas of w x h pixels whose transform is that of photograph pixels. */
function paintPhotograph(context, at, w, h) {
  if (!doc.photographs.length) return;
  const { columns, rows } = size();
  const whole = picture(`picture/${shown}`);
  context.imageSmoothingEnabled = at.scale < 3;
  context.imageSmoothingQuality = "high";
  if (whole) context.drawImage(whole, -0.5, -0.5, columns, rows);
  if (whole && at.scale <= whole.naturalWidth / columns * 1.001) return;
  if (whole && whole.naturalWidth === columns) return;
  const first = [Math.floor(at.x / doc.tile), Math.floor(at.y / doc.tile)].map((n) => Math.max(0, n));
  const end = [Math.min(columns - 1, at.x + w / at.scale), Math.min(rows - 1, at.y + h / at.scale)];
  for (let row = first[1]; row * doc.tile <= end[1]; row++)
    for (let column = first[0]; column * doc.tile <= end[0]; column++) {
      const tile = picture(`tile/${shown}/${column}/${row}`);
      if (tile) context.drawImage(tile, column * doc.tile - 0.5, row * doc.tile - 0.5);
    }
}

function show(number) {
  shown = Math.max(0, Math.min(doc.photographs.length - 1, number));
  subject.shown?.();
  refresh();
}

// --- the view -----------------------------------------------------------------------------------

const at = { x: 0, y: 0, scale: 1 }; // the photograph's place at the upper left, screen pixels per pixel

const screen = ([x, y], from = at) => [(x - from.x) * from.scale, (y - from.y) * from.scale];
const place = (x, y) => [x / at.scale + at.x, y / at.scale + at.y];

function fit() {
  const { columns, rows } = size();
  const edge = 28;
  at.scale = Math.max(1e-3, Math.min((view.clientWidth - 2 * edge) / columns, (view.clientHeight - 2 * edge) / rows));
  at.x = columns / 2 - 0.5 - view.clientWidth / 2 / at.scale;
  at.y = rows / 2 - 0.5 - view.clientHeight / 2 / at.scale;
  draw();
}

/** About a place of the screen; else about the chosen mark, or the middle where that is out of sight. */
function zoom(factor, x, y) {
  if (x === undefined) {
    const w = view.clientWidth, h = view.clientHeight, chosen = subject.place();
    [x, y] = chosen ? screen(chosen) : [-1, -1];
    if (x < 0 || y < 0 || x > w || y > h) [x, y] = [w / 2, h / 2];
  }
  const [px, py] = place(x, y);
  at.scale = Math.max(0.01, Math.min(80, at.scale * factor));
  at.x = px - x / at.scale;
  at.y = py - y / at.scale;
  draw();
}

/** Show the chosen mark, if it is out of sight. */
function reveal() {
  const chosen = subject.place();
  if (!chosen) return;
  const [x, y] = screen(chosen);
  const w = view.clientWidth, h = view.clientHeight;
  if (x > 20 && y > 20 && x < w - 20 && y < h - 20) return;
  at.x = chosen[0] - w / 2 / at.scale;
  at.y = chosen[1] - h / 2 / at.scale;
}

function prepared(canvas) {
  const ratio = devicePixelRatio || 1;
  const [w, h] = [canvas.clientWidth, canvas.clientHeight];
  if (canvas.width !== Math.round(w * ratio) || canvas.height !== Math.round(h * ratio)) {
    canvas.width = Math.round(w * ratio);
    canvas.height = Math.round(h * ratio);
  }
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, w, h);
  return [context, w, h];
}

function paint(canvas, from) {
  const [context, w, h] = prepared(canvas);
  context.save();
  context.scale(from.scale, from.scale);
  context.translate(-from.x, -from.y);
  paintPhotograph(context, from, w, h);
  subject.below?.(context);
  context.restore();
  subject.paint(context, from, canvas === loupe);
}

let waiting = false;
function draw() {
  if (waiting) return;
  waiting = true;
  requestAnimationFrame(() => {
    waiting = false;
    paint(view, at);
    byId("zoom").value = `${Math.round(100 * at.scale)} %`;
    const chosen = subject.place();
    loupe.hidden = !chosen || doc.kind === "mesh";
    if (loupe.hidden) return;
    const scale = Math.max(6, 3 * at.scale);
    paint(loupe, {
      scale, x: chosen[0] - loupe.clientWidth / 2 / scale, y: chosen[1] - loupe.clientHeight / 2 / scale,
    });
  });
}

/** A cross with an open middle, dark below and bright above, so that any ground shows it. */
function cross(context, [x, y], chosen, colour, fine) {
  const inner = 3, outer = fine ? 400 : chosen ? 16 : 12;
  for (const [stroke, width] of [["rgba(0,0,0,.8)", chosen ? 4.5 : 3.6], [colour, chosen ? 2.2 : 1.7]]) {
    context.strokeStyle = stroke;
    context.lineWidth = fine ? width / 2 : width;
    context.beginPath();
    for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
      context.moveTo(x + dx * inner, y + dy * inner);
      context.lineTo(x + dx * outer, y + dy * outer);
    }
    context.stroke();
  }
}

function label(context, text, [x, y]) {
  context.font = "600 12px system-ui, sans-serif";
  context.lineWidth = 3.5;
  context.lineJoin = "round";
  context.strokeStyle = "rgba(0,0,0,.75)";
  context.strokeText(text, x + 9, y - 9);
  context.fillStyle = "#fff";
  context.fillText(text, x + 9, y - 9);
}

const CHOSEN = "#ffc24d", OTHER = "#7fe0e8";

// --- pointers -----------------------------------------------------------------------------------

const held = new Map(); // pointers that are down, by their number
let grabbed = null;

const near = (event) => [event.clientX - view.getBoundingClientRect().left, event.clientY - view.getBoundingClientRect().top];

view.addEventListener("pointerdown", (event) => {
  view.setPointerCapture(event.pointerId);
  held.set(event.pointerId, near(event));
  if (held.size > 1) return (grabbed = null);
  last = { label: "", time: 0 };
  grabbed = subject.grab(place(...near(event)), REACH / at.scale);
  view.classList.toggle("held", !grabbed);
  refresh();
});

view.addEventListener("pointermove", (event) => {
  const now = near(event), before = held.get(event.pointerId);
  if (!before) return view.classList.toggle("over", Boolean(subject.over?.(place(...now), REACH / at.scale)));
  if (held.size === 2) {
    const [other] = [...held].filter(([id]) => id !== event.pointerId).map(([, point]) => point);
    const far = (a, b) => Math.hypot(a[0] - b[0], a[1] - b[1]);
    zoom(far(now, other) / Math.max(1, far(before, other)), (now[0] + other[0]) / 2, (now[1] + other[1]) / 2);
    at.x -= (now[0] - before[0]) / 2 / at.scale;
    at.y -= (now[1] - before[1]) / 2 / at.scale;
  } else if (grabbed) {
    const [was, is] = [place(...before), place(...now)];
    last.time = performance.now();
    change("drag", () => grabbed(is, [is[0] - was[0], is[1] - was[1]]));
  } else {
    at.x -= (now[0] - before[0]) / at.scale;
    at.y -= (now[1] - before[1]) / at.scale;
  }
  held.set(event.pointerId, now);
  draw();
});

for (const name of ["pointerup", "pointercancel"])
  view.addEventListener(name, (event) => {
    held.delete(event.pointerId);
    grabbed = null;
    last = { label: "", time: 0 };
    view.classList.remove("held");
  });

view.addEventListener("wheel", (event) => {
  event.preventDefault();
  const lines = event.deltaMode === 1 ? 30 : 1;
  zoom(Math.exp(-event.deltaY * lines * (event.ctrlKey ? 0.01 : 0.0016)), ...near(event));
}, { passive: false });

// --- keys ---------------------------------------------------------------------------------------

const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

view.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  const step = event.shiftKey ? COARSE : FINE;
  if (event.key in ARROWS) subject.arrow(ARROWS[event.key], step);
  else if (event.key === "n" || event.key === "N") subject.next(1);
  else if (event.key === "p" || event.key === "P") subject.next(-1);
  else if (event.key === "+" || event.key === "=") zoom(1.25);
  else if (event.key === "-") zoom(0.8);
  else if (event.key === "0") fit();
  else if (event.key === ",") show(shown - 1);
  else if (event.key === ".") show(shown + 1);
  else if (!subject.key?.(event)) return;
  event.preventDefault();
});

addEventListener("keydown", (event) => {
  if (!(event.ctrlKey || event.metaKey)) return;
  const key = event.key.toLowerCase();
  if (key === "s") save();
  else if (event.target.matches("input")) return;
  else if (key === "z") event.shiftKey ? restore(future, past) : restore(past, future);
  else if (key === "y") restore(future, past);
  else return;
  event.preventDefault();
});

// --- the panel ----------------------------------------------------------------------------------

function element(name, properties = {}, ...children) {
  const made = Object.assign(document.createElement(name), properties);
  made.append(...children);
  return made;
}

const button = (text, onclick, properties = {}) => element("button", { textContent: text, onclick, ...properties });

/** A list of things of which one is chosen; rebuilt only where its contents differ. */
function list(section, heading, items, current, choose) {
  const key = JSON.stringify([items, current]);
  if (section.dataset.key === key) return;
  const active = section.contains(document.activeElement);
  section.dataset.key = key;
  section.replaceChildren(element("h2", { textContent: heading }), element("ul", {}, ...items.map(([text, small], n) => {
    const one = button("", () => { choose(n); view.focus({ preventScroll: true }); });
    one.append(element("span", { textContent: text, title: text }), element("small", { textContent: small }));
    if (n === current) one.setAttribute("aria-current", "true");
    return element("li", {}, one);
  })));
  if (active) section.querySelector("[aria-current]")?.focus();
}

/** Number fields of the chosen thing: name, value, step and what a new value does. */
function fields(all) {
  const box = byId("numbers");
  const names = all.map(([name]) => name).join();
  if (box.dataset.names !== names) {
    box.dataset.names = names;
    box.replaceChildren(...all.map(([name, , step]) =>
      element("label", { textContent: name }, element("input", { type: "number", step }))));
  }
  all.forEach(([, value, , set], n) => {
    const input = box.children[n].querySelector("input");
    if (document.activeElement !== input) input.value = value;
    input.onchange = () => Number.isFinite(input.valueAsNumber) && set(input.valueAsNumber);
  });
}

/** Build what a section holds anew where the key differs; the control with the focus keeps it. */
function rebuild(section, key, made) {
  if (section.dataset.key === key) return;
  section.dataset.key = key;
  section.className = "stack";
  const controls = () => [...section.querySelectorAll("button, input, summary")];
  const focused = controls().indexOf(document.activeElement);
  section.replaceChildren(...made());
  if (focused >= 0) controls()[Math.min(focused, controls().length - 1)]?.focus();
}

let told;
function tell(text) {
  clearTimeout(told);
  told = setTimeout(() => { live.textContent = text; }, 250);
}

function refresh() {
  byId("undo").disabled = !past.length;
  byId("redo").disabled = !future.length;
  const dirty = JSON.stringify(subject.state) !== saved;
  byId("save").disabled = !dirty;
  document.title = `${dirty ? "• " : ""}${doc.file}`;
  if (doc.photographs.length > 1) {
    list(byId("photographs"), "Photographs", doc.photographs.map((one, n) => [one.name, subject.said?.(n) ?? ""]), shown, show);
  }
  subject.panel();
  draw();
}

function keys(pairs) {
  const usual = [["N, P", "next, previous"], ["Wheel, + −", "zoom"], ["0", "show all"], ["Ctrl Z", "undo"], ["Ctrl S", "save"]];
  if (doc.photographs.length > 1) usual.splice(1, 0, [", .", "photograph before, after"]);
  byId("keys").replaceChildren(...[...pairs, ...usual].flatMap(([key, what]) => [
    element("dt", { textContent: key }), element("dd", { textContent: what })]));
}

const note = (text) => element("p", { className: "note", textContent: text });
const fixed = (number, digits = 2) => number.toFixed(digits).replace("-", "−");
const brief = (name) => name.replace(/^(marker \d+, .*) corner$/, "$1");
const rounded = (number) => Math.round(1000 * number) / 1000;
const distance = (a, b) => Math.hypot(a[0] - b[0], a[1] - b[1]);

// --- marks --------------------------------------------------------------------------------------

function marksSubject() {
  let chosen = 0;
  const self = {
    state: { points_mm: doc.points_mm, points: doc.points },
    content: () => ({
      size_mm: doc.size_mm, points_mm: self.state.points_mm, kind: doc.mark_kind, search_px: doc.search_px,
      photographs: self.state.points,
    }),
    names: () => Object.keys(self.state.points_mm),
    owner: (n = shown) => (doc.photographs[n].name in self.state.points ? doc.photographs[n].name : "default"),
    own: () => self.state.points[self.owner()] ?? {},
    place: () => self.own()[self.names()[chosen]],
    said: (n) => {
      const owner = self.owner(n);
      if (!(owner in self.state.points)) return "no marks";
      return doc.notes[doc.photographs[n].name] ? "check" : owner === "default" ? "" : "own marks";
    },
    restored: () => { chosen = Math.min(chosen, self.names().length - 1); },
    move: (name, [x, y]) => { self.own()[name] = [rounded(x), rounded(y)]; },
    over: (point, reach) => {
      const all = Object.entries(self.own()).map(([name, place]) => [distance(point, place), name]).sort((a, b) => a[0] - b[0]);
      return all.length && all[0][0] <= reach ? all[0][1] : null;
    },
    grab: (point, reach) => {
      const name = self.over(point, reach);
      if (!name) return null;
      chosen = self.names().indexOf(name);
      return (now, by) => self.move(name, [self.own()[name][0] + by[0], self.own()[name][1] + by[1]]);
    },
    next: (by) => {
      const count = self.names().length;
      chosen = (chosen + by + count) % count;
      reveal();
      refresh();
    },
    arrow: ([x, y], step) => {
      const before = self.place();
      if (before) change(`move ${shown} ${chosen}`, () => self.move(self.names()[chosen], [before[0] + step * x, before[1] + step * y]));
      reveal();
    },
    paint: (context, from, fine) => {
      const own = self.own(), name = self.names()[chosen];
      if (!fine) {
        const corners = ["upper left", "upper right", "lower right", "lower left"].map((one) => own[one]);
        if (corners.every(Boolean)) {
          context.strokeStyle = "rgba(127,224,232,.55)";
          context.lineWidth = 1;
          context.beginPath();
          corners.forEach((corner) => context.lineTo(...screen(corner, from)));
          context.closePath();
          context.stroke();
        }
      }
      for (const [one, point] of Object.entries(own)) {
        if (fine && one !== name) continue;
        cross(context, screen(point, from), one === name, one === name ? CHOSEN : OTHER, fine);
      }
      const few = Object.keys(own).length <= 8;
      if (!fine) for (const [one, point] of Object.entries(own)) if (few || one === name) label(context, brief(one), screen(point, from));
    },
    panel: () => {
      const names = self.names(), name = names[chosen], point = self.place();
      byId("title").textContent = "Marks";
      byId("name").textContent = name;
      view.setAttribute("aria-label", `${doc.photographs[shown].name}: marks`);
      fields(point ? [
        ["column", point[0].toFixed(2), 0.1, (x) => change("column", () => self.move(name, [x, self.place()[1]]))],
        ["row", point[1].toFixed(2), 0.1, (y) => change("row", () => self.move(name, [self.place()[0], y]))],
      ] : []);
      const own = self.own();
      list(byId("list"), "Marks", names.map((one) => [brief(one), own[one] ? `${fixed(own[one][0], 1)}, ${fixed(own[one][1], 1)}` : "not here"]),
        chosen, (n) => { chosen = n; reveal(); refresh(); });
      self.tools(name, point);
      if (point) tell(`${name}: column ${fixed(point[0])}, row ${fixed(point[1])}`);
    },
    tools: (name, point) => {
      const photograph = doc.photographs[shown].name, owner = self.owner(), points = self.state.points;
      const many = Object.keys(self.own()).length > 4;
      const key = JSON.stringify([shown, name, owner, Boolean(point), many, Object.keys(points)]);
      rebuild(byId("tools"), key, () => {
        const made = [], said = doc.notes[photograph] ?? doc.notes.default;
        if (said) made.push(note(said));
        if (!(owner in points)) {
          const other = Object.keys(points)[0];
          made.push(button(`Begin with the marks of ${other}`, () => change("begin", () => { points[photograph] = structuredClone(points[other]); })));
          return made;
        }
        const box = element("input", { type: "checkbox", checked: owner !== "default", onchange: () => change("own", () => {
          if (box.checked) self.state.points[photograph] = structuredClone(self.own());
          else delete self.state.points[photograph];
        }) });
        // Without marks for all, a photograph needs its own.
        box.disabled = owner !== "default" && !points.default;
        if (doc.photographs.length > 1) made.push(
          element("label", { className: "check" }, box, "This photograph has marks of its own"),
          button("Copy to all after it", () => change("copy", () => {
            for (const one of doc.photographs.slice(shown + 1)) self.state.points[one.name] = structuredClone(self.own());
          }), { disabled: shown + 1 >= doc.photographs.length }));
        if (!point) made.push(button("Place it here", () => change("place", () => self.move(name, place(view.clientWidth / 2, view.clientHeight / 2)))));
        else if (many) made.push(button("Remove it here", () => change("remove", () => { delete self.own()[name]; })));
        made.push(self.adding ??= self.form());
        return made;
      });
    },
    form: () => {
      const input = (text, type) => element("label", { textContent: text }, element("input", { type, step: "any" }));
      const inputs = [input("name", "text"), input("x, mm from the middle to the right", "number"), input("y, mm from the middle up", "number")];
      return element("details", {}, element("summary", { textContent: "Add a mark" }), ...inputs, button("Add", () => {
        const [name, x, y] = inputs.map((one) => one.querySelector("input"));
        const called = name.value.trim();
        if (!called || called in self.state.points_mm || !Number.isFinite(x.valueAsNumber + y.valueAsNumber)) return name.focus();
        change("add", () => {
          self.state.points_mm[called] = [x.valueAsNumber, y.valueAsNumber];
          self.move(called, place(view.clientWidth / 2, view.clientHeight / 2));
          chosen = self.names().length - 1;
        });
        name.value = "";
        view.focus();
      }));
    },
  };
  keys([["Arrows", "0.1 pixels"], ["Shift arrows", "1 pixel"]]);
  return self;
}

// --- balls --------------------------------------------------------------------------------------

/** Middle and radius of the circle through three points; null if they lie on a line. */
function circleThrough([a, b, c]) {
  const [bx, by, cx, cy] = [b[0] - a[0], b[1] - a[1], c[0] - a[0], c[1] - a[1]];
  const turn = 2 * (bx * cy - by * cx);
  if (Math.abs(turn) < 1e-6) return null;
  const x = (cy * (bx * bx + by * by) - by * (cx * cx + cy * cy)) / turn;
  const y = (bx * (cx * cx + cy * cy) - cx * (bx * bx + by * by)) / turn;
  return [a[0] + x, a[1] + y, Math.hypot(x, y)];
}

function ballsSubject() {
  const handles = ([x, y, r]) => [-90, 30, 150].map((turn) => [x + r * Math.cos(turn * Math.PI / 180), y + r * Math.sin(turn * Math.PI / 180)]);
  const HANDLES = ["upper edge", "right edge", "left edge"];
  let ball = 0, handle = 0; // handle 3 is the middle
  const self = {
    state: { sets: doc.sets.map((one) => one.circles.map(handles)) },
    content: () => ({ sets: self.state.sets.map((one) => one.map((points) => circleThrough(points).map(rounded))) }),
    number: () => doc.photographs[shown].set,
    own: () => self.state.sets[self.number()],
    places: (points) => [...points, circleThrough(points).slice(0, 2)],
    place: () => self.own()[ball] && self.places(self.own()[ball])[handle],
    shown: () => { ball = Math.min(ball, self.own().length - 1); },
    restored: () => self.shown(),
    said: (n) => (doc.sets.length > 1 ? doc.sets[doc.photographs[n].set].name : ""),
    over: (point, reach) => {
      const all = self.own().flatMap((points, b) => self.places(points).map((one, h) => [distance(point, one), b, h])).sort((p, q) => p[0] - q[0]);
      return all.length && all[0][0] <= reach ? all[0].slice(1) : null;
    },
    moved: ([dx, dy]) => {
      const points = structuredClone(self.own()[ball]);
      for (const n of handle === 3 ? [0, 1, 2] : [handle]) points[n] = [points[n][0] + dx, points[n][1] + dy];
      const circle = circleThrough(points);
      // Handles on a line make no circle.
      if (circle && circle[2] < 20 * Math.max(size().columns, size().rows)) self.own()[ball] = points;
    },
    grab: (point, reach) => {
      const found = self.over(point, reach);
      if (!found) return null;
      [ball, handle] = found;
      return (now, by) => self.moved(by);
    },
    next: (by) => {
      const count = 4 * self.own().length, now = (4 * ball + handle + by + count) % count;
      [ball, handle] = [Math.floor(now / 4), now % 4];
      reveal();
      refresh();
    },
    arrow: ([x, y], step) => {
      change(`move ${shown} ${ball} ${handle}`, () => self.moved([step * x, step * y]));
      reveal();
    },
    paint: (context, from, fine) => {
      self.own().forEach((points, b) => {
        const [x, y, r] = circleThrough(points), [sx, sy] = screen([x, y], from);
        for (const [stroke, width] of [["rgba(0,0,0,.7)", 3], [b === ball ? CHOSEN : OTHER, 1.4]]) {
          context.strokeStyle = stroke;
          context.lineWidth = fine ? width * 0.7 : width;
          context.beginPath();
          context.arc(sx, sy, r * from.scale, 0, 2 * Math.PI);
          context.stroke();
        }
        if (fine) return;
        points.forEach((point, h) => {
          context.beginPath();
          context.arc(...screen(point, from), b === ball && h === handle ? 7 : 5, 0, 2 * Math.PI);
          context.fillStyle = b === ball && h === handle ? CHOSEN : "#fff";
          context.strokeStyle = "rgba(0,0,0,.8)";
          context.lineWidth = 1.5;
          context.fill();
          context.stroke();
        });
        cross(context, [sx, sy], b === ball && handle === 3, b === ball && handle === 3 ? CHOSEN : OTHER);
        if (self.own().length > 1) label(context, `ball ${b + 1}`, [sx, sy]);
      });
    },
    panel: () => {
      const points = self.own()[ball], [x, y, r] = circleThrough(points);
      const set = ([nx, ny, nr]) => change("circle", () => { if (nr > 0) self.own()[ball] = handles([nx, ny, nr]); });
      const called = self.own().length > 1 ? `ball ${ball + 1}` : doc.sets[self.number()].name;
      byId("title").textContent = "Mirror balls";
      byId("name").textContent = `${called}, ${HANDLES[handle] ?? "middle"}`;
      view.setAttribute("aria-label", `${doc.photographs[shown].name}: outlines of mirror balls`);
      const plain = (number) => number.toFixed(2);
      fields([["column", plain(x), 0.1, (v) => set([v, y, r])], ["row", plain(y), 0.1, (v) => set([x, v, r])], ["radius", plain(r), 0.1, (v) => set([x, y, v])]]);
      list(byId("list"), "Outlines", self.own().map((one, b) => {
        const [cx, cy, cr] = circleThrough(one);
        return [self.own().length > 1 ? `ball ${b + 1}` : called, `${fixed(cx, 1)}, ${fixed(cy, 1)} · ${fixed(cr, 1)}`];
      }), ball, (n) => { ball = n; handle = 0; reveal(); refresh(); });
      rebuild(byId("tools"), JSON.stringify([self.number(), self.own().length]), () => {
        const made = [], said = doc.notes[doc.sets[self.number()].name];
        if (said) made.push(note(said));
        if (doc.alone) return made;
        const add = () => change("add", () => {
          const [cx, cy] = place(view.clientWidth / 2, view.clientHeight / 2);
          self.own().push(handles([cx, cy, circleThrough(self.own()[0])[2]]));
          ball = self.own().length - 1;
        });
        const remove = () => change("remove", () => { self.own().splice(ball, 1); self.shown(); });
        return [...made, element("div", { className: "row" }, button("Add", add),
          button("Remove", remove, { disabled: self.own().length < 2 }))];
      });
      tell(`${byId("name").textContent}: middle ${fixed(x)}, ${fixed(y)}, radius ${fixed(r)}`);
    },
  };
  keys([["Arrows", "0.1 pixels"], ["Shift arrows", "1 pixel"]]);
  return self;
}

// --- the depth mesh -----------------------------------------------------------------------------

function meshSubject() {
  const rows = doc.depth_mm.length, columns = doc.depth_mm[0].length;
  const small = element("canvas", { width: columns, height: rows });
  const STEPS = [0.01, 0.1]; // mm of a key, and with Shift
  let row = rows >> 1, column = columns >> 1, tool = "choose", reach = 2, strong = 0.8;
  const across = 1200 / Math.max(...doc.size_mm);
  const self = {
    state: { depth: doc.depth_mm },
    size: { columns: doc.size_mm[0] * across, rows: doc.size_mm[1] * across },
    content: () => ({ depth_mm: self.state.depth }),
    node: (r, c) => [c / (columns - 1) * size().columns - 0.5, r / (rows - 1) * size().rows - 0.5],
    place: () => self.node(row, column),
    found: ([x, y]) => [
      Math.max(0, Math.min(rows - 1, (y + 0.5) / size().rows * (rows - 1))),
      Math.max(0, Math.min(columns - 1, (x + 0.5) / size().columns * (columns - 1))),
    ],
    range: () => {
      const all = self.state.depth.flat(), low = Math.min(...all), high = Math.max(...all);
      return [low, high > low ? high : low + 1e-6];
    },
    /** Each node within the brush becomes more like the mean of its neighbours. */
    smooth: (at) => {
      const [r0, c0] = self.found(at), before = structuredClone(self.state.depth);
      const height = (r, c) => before[Math.max(0, Math.min(rows - 1, r))][Math.max(0, Math.min(columns - 1, c))];
      for (let r = Math.ceil(Math.max(0, r0 - reach)); r <= Math.min(rows - 1, r0 + reach); r++)
        for (let c = Math.ceil(Math.max(0, c0 - reach)); c <= Math.min(columns - 1, c0 + reach); c++) {
          const away = Math.hypot(r - r0, c - c0) / reach;
          if (away > 1) continue;
          const mean = (height(r - 1, c) + height(r + 1, c) + height(r, c - 1) + height(r, c + 1)) / 4;
          const weight = 0.35 * (1 - away * away);
          self.state.depth[r][c] = Math.round(1e4 * (before[r][c] + weight * (mean - before[r][c]))) / 1e4;
        }
    },
    grab: (point) => {
      const [r, c] = self.found(point);
      if (tool === "smooth") {
        change("smooth", () => self.smooth(point));
        last.label = "drag";
        return (now) => self.smooth(now);
      }
      const [x, y] = point;
      if (x < -0.5 || y < -0.5 || x > size().columns || y > size().rows) return null;
      [row, column] = [Math.round(r), Math.round(c)];
      return null;
    },
    raise: (mm) => change(`raise ${row} ${column}`, () => {
      self.state.depth[row][column] = Math.round(1e4 * (self.state.depth[row][column] + mm)) / 1e4;
    }),
    next: (by) => {
      const now = (row * columns + column + by + rows * columns) % (rows * columns);
      [row, column] = [Math.floor(now / columns), now % columns];
      reveal();
      refresh();
    },
    arrow: ([x, y], step) => {
      const by = step === FINE ? 1 : 5;
      row = Math.max(0, Math.min(rows - 1, row + by * y));
      column = Math.max(0, Math.min(columns - 1, column + by * x));
      reveal();
      refresh();
    },
    key: (event) => {
      const step = STEPS[event.shiftKey ? 1 : 0];
      if (event.key === "PageUp") self.raise(step);
      else if (event.key === "PageDown") self.raise(-step);
      else if (event.key === "b" || event.key === "B") { tool = tool === "smooth" ? "choose" : "smooth"; refresh(); }
      else return false;
      return true;
    },
    below: (context) => {
      const [low, high] = self.range(), data = new ImageData(columns, rows);
      self.state.depth.flat().forEach((height, n) => {
        data.data.set([...doc.ramp[Math.round(255 * (height - low) / (high - low))], 255], 4 * n);
      });
      small.getContext("2d").putImageData(data, 0, 0);
      const [w, h] = [size().columns, size().rows], [dx, dy] = [w / (columns - 1), h / (rows - 1)];
      context.save();
      context.beginPath();
      context.rect(-0.5, -0.5, w, h);
      context.clip();
      context.globalAlpha = doc.photographs.length ? strong : 1;
      context.imageSmoothingEnabled = true;
      // The middles of the small canvas's pixels come to lie on the nodes.
      context.drawImage(small, -0.5 - dx / 2, -0.5 - dy / 2, w + dx, h + dy);
      context.restore();
    },
    paint: (context, from) => {
      const apart = size().columns / (columns - 1) * from.scale;
      context.fillStyle = "rgba(255,255,255,.55)";
      if (apart > 7) for (let r = 0; r < rows; r++) for (let c = 0; c < columns; c++) {
        const [x, y] = screen(self.node(r, c), from);
        context.fillRect(x - 1, y - 1, 2, 2);
      }
      const [x, y] = screen(self.place(), from);
      for (const [stroke, width] of [["rgba(0,0,0,.8)", 4], [CHOSEN, 2]]) {
        context.strokeStyle = stroke;
        context.lineWidth = width;
        context.beginPath();
        context.arc(x, y, 7, 0, 2 * Math.PI);
        context.stroke();
      }
    },
    panel: () => {
      const height = self.state.depth[row][column], [w, h] = doc.size_mm, [low, high] = self.range();
      const x = (column / (columns - 1) - 0.5) * w, y = (0.5 - row / (rows - 1)) * h;
      byId("title").textContent = "Depth mesh";
      byId("name").textContent = `Node at ${fixed(x, 1)}, ${fixed(y, 1)} mm`;
      view.setAttribute("aria-label", "Heights of the painting");
      fields([["height, mm", height.toFixed(4), 0.01, (mm) => change("height", () => { self.state.depth[row][column] = Math.round(1e4 * mm) / 1e4; })]]);
      const section = byId("list");
      if (!section.children.length) self.build(section);
      self.text[0].textContent = `${fixed(low)} mm`;
      self.text[1].textContent = `${fixed(high)} mm`;
      self.tool.forEach((one) => { one.checked = one.value === tool; });
      tell(`${byId("name").textContent}: height ${fixed(height, 3)} mm`);
    },
    build: (section) => {
      const ramp = element("canvas", { className: "ramp", width: 256, height: 1 });
      ramp.setAttribute("aria-hidden", "true");
      const data = new ImageData(256, 1);
      doc.ramp.forEach((rgb, n) => data.data.set([...rgb, 255], 4 * n));
      ramp.getContext("2d").putImageData(data, 0, 0);
      self.text = [element("span"), element("span")];
      const radio = (value) => element("input", { type: "radio", name: "tool", value, onchange: () => { tool = value; view.focus(); refresh(); } });
      self.tool = [radio("choose"), radio("smooth")];
      const slider = (name, min, max, step, value, set) => element("label", { textContent: name },
        element("input", { type: "range", min, max, step, value, oninput: (event) => { set(event.target.valueAsNumber); draw(); } }));
      section.className = "stack";
      section.append(
        element("h2", { textContent: "Height above the plane of the marks" }), ramp,
        element("div", { className: "scale" }, ...self.text),
        element("div", { className: "row" }, button("Higher", () => self.raise(STEPS[0])), button("Lower", () => self.raise(-STEPS[0]))),
        element("label", { className: "check" }, self.tool[0], "Choose a node"),
        element("label", { className: "check" }, self.tool[1], "Smooth with a brush"),
        slider("radius of the brush, nodes", 1, 8, 0.5, reach, (value) => { reach = value; }));
      if (doc.photographs.length) section.append(slider("colours over the photograph", 0, 1, 0.05, strong, (value) => { strong = value; }));
    },
  };
  keys([["Arrows", "another node"], ["Page Up, Down", "0.01 mm, with Shift 0.1"], ["B", "brush"]]);
  return self;
}

// --- start --------------------------------------------------------------------------------------

byId("file").textContent = doc.file;
byId("undo").onclick = () => restore(past, future);
byId("redo").onclick = () => restore(future, past);
byId("save").onclick = save;
byId("in").onclick = () => zoom(1.25);
byId("out").onclick = () => zoom(0.8);
byId("fit").onclick = fit;
new ResizeObserver(draw).observe(view);
fit();
refresh();
view.focus();
document.documentElement.dataset.ready = "true";
