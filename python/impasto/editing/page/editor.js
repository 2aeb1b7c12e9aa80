// The view, its pointers and keys, and the panel of the page; what is edited is a subject of its own.
// Places are in pixels of the photograph; whole numbers are the middles of pixels, as in the files.

const byId = (id) => document.getElementById(id);
const view = byId("view"), loupe = byId("loupe"), live = byId("live");
const REACH = 14; // screen pixels within which a pointer takes hold of a mark
const FINE = 0.1, COARSE = 1; // pixels of an arrow key, and with Shift
const PATIENT = 700; // ms within which steps of one key are one change

const doc = await (await fetch("document.json")).json();
let subject; // what is edited, from start()

// --- changes ------------------------------------------------------------------------------------

let saved = ""; // the state that the file has
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
const rounded = (number) => Math.round(1000 * number) / 1000;
const distance = (a, b) => Math.hypot(a[0] - b[0], a[1] - b[1]);

/** Show the page for a subject: its state, how it is painted, grabbed and moved, its panel. */
function start(made) {
  subject = made;
  if (doc.exists) saved = JSON.stringify(subject.state);
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
}

export {
  byId, view, FINE, doc, shown, change, reveal, refresh, screen, place, size, cross, label, CHOSEN,
  OTHER, fields, list, rebuild, tell, note, fixed, rounded, distance, button, element, keys, draw,
  start,
};
