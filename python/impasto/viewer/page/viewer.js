// A painting in an element: pointer, keys, tiles, and what is drawn when.

import { Tiles } from "./tiles.js";
import { Renderer } from "./renderer.js";
import { pixelValues, rangesOf } from "./values.js";
import { svg } from "./plots.js";
import { annotationPage, annotationsOf, note, placeOf, storeAnnotations, storedAnnotations } from "./annotations.js";
import { RAKING_STOPS, anglesFromPlane, h, lightWords, panel } from "./controls.js";
import { download, noteDialog, upright } from "./saving.js";
import { directionOf, firstState, stateOfText, textOfState } from "./state.js";

const FORMAT = 1;
const LARGEST_PICTURE = 1 << 26; // pixels of a PNG
const TOOLS = [["light", "Light", "L", "Drag to move the light"], ["move", "Move", "M", "Drag to move the painting"],
  ["inspect", "Inspect", "I", "Choose a place to see its values"], ["note", "Note", "N", "Draw a rectangle to measure it and to write a note"]];
const SLOW = 70, QUICK = 28; // ms between frames at which a moving light is shown more coarsely, or finely again

export class Viewer {
  constructor(element, doc, source) {
    if (doc.format !== FORMAT) throw new Error(`the painting has the format ${doc.format}, this page shows ${FORMAT}`);
    Object.assign(this, { element, doc, source, tool: "light", coarse: 0, dragging: false, notes: storedAnnotations(doc), statuses: [], first: firstState(doc), pointers: new Map() });
    this.build();
    this.renderer = new Renderer(this.canvas, doc);
    this.tiles = new Tiles(source, (name, entry) => this.arrived(name, entry));
    this.panel = panel(this);
    this.element.append(this.panel.element);
    this.state = stateOfText(location.hash, doc);
    this.listen();
    this.choose("light");
    this.start();
  }

  async start() {
    // The smallest scale first: something is seen at once, and the ranges of the layers are known.
    const name = `${this.doc.scales.length - 1}/0-0`;
    const buffer = await this.tiles.get(name);
    this.started = true;
    if (buffer) {
      const { ranges, statuses } = rangesOf(this.doc, buffer, this.sizeOf(name));
      Object.assign(this.renderer.ranges, ranges);
      this.statuses = statuses;
    }
    this.showNotes(this.notes, true);
    this.changed();
    if (this.state.photograph >= 0) this.compareWith(this.state.photograph);
    if (this.state.pixel) this.inspect(...this.state.pixel);
  }

  build() {
    const { doc } = this, title = doc.title || "A painting";
    document.title = doc.title ? `${doc.title} – impasto` : "impasto";
    this.canvas = h("canvas", { tabIndex: 0, role: "application", "aria-label": `${title}, ${doc.width} by ${doc.height} pixels. Arrows move the light; the panel has all controls.` });
    this.over = svg("svg", { class: "over", "aria-hidden": "true" });
    this.buttons = TOOLS.map(([name, label, key, title]) => h("button", { type: "button", title: `${title} (${key})`, "aria-pressed": "false", onclick: () => this.choose(name) }, label));
    this.readout = h("output", { className: "readout", "aria-live": "polite" });
    this.scaleBar = h("div", { className: "scale", hidden: !doc.pitch });
    this.divider = h("div", { className: "divider", role: "slider", tabIndex: 0, hidden: true, "aria-label": "Line between picture and photograph", "aria-valuemin": 0, "aria-valuemax": 100 }, h("span"));
    this.wait = h("p", { className: "wait", role: "status" }, "Loading");
    this.stage = h("div", { className: "stage" }, this.canvas, this.over, this.divider, this.wait,
      h("header", {}, h("h1", {}, title), h("div", { className: "row tools", role: "toolbar", "aria-label": "What dragging does" }, ...this.buttons),
        h("button", { type: "button", className: "toggle", title: "Hide or show the controls (H)", "aria-label": "Controls", onclick: () => this.togglePanel() }, "☰")),
      h("footer", {}, this.readout, this.scaleBar));
    this.element.replaceChildren(this.stage);
  }

  togglePanel() {
    this.element.classList.toggle("bare");
  }

  // --- state

  set(changes) {
    Object.assign(this.state, changes);
    this.changed();
  }

  changed() {
    if (!this.renderer) return;
    this.stale = true;
    this.panel.update(this.state);
    this.readout.textContent = this.state.photograph >= 0 ? `The lamp of photograph no. ${this.doc.photographs[this.state.photograph].number + 1}` : lightWords(this.onPage(this.state.azimuth), this.state.elevation);
    this.redraw();
    clearTimeout(this.linking);
    this.linking = setTimeout(() => this.link(), 250);
  }

  link() {
    const text = `#${textOfState(this.state, this.doc)}`;
    this.linked = text;
    try {
      history.replaceState(null, "", text);
    } catch {
      // A page in a frame or a notebook may have no address of its own.
    }
  }

  // By a place in the unit circle of the page: right and up.
  lightAt(x, y) {
    const { azimuth, elevation } = anglesFromPlane(x, y);
    this.set({ azimuth: this.onPainting(azimuth), elevation, photograph: -1 });
  }

  turn90() {
    this.set({ turns: (this.state.turns + 1) % 4, view: null });
  }

  lightKey(event) {
    const step = event.shiftKey ? 1 : 5, { azimuth, elevation } = this.state;
    const [x, y] = directionOf(this.onPage(azimuth), elevation);
    const moves = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
    const move = moves[event.key];
    if (!move) return false;
    event.preventDefault();
    event.stopPropagation();
    const radians = step * Math.PI / 180;
    this.lightAt(x + radians * move[0], y + radians * move[1]);
    return true;
  }

  // --- view

  // Columns and rows of the canvas per pixel of the painting, and where the painting's middle of view lies.
  get view() {
    if (this.state.view) return this.state.view;
    const { width, height, clientWidth } = this.canvas, ratio = width / clientWidth || 1;
    const [above, below, beside] = [60, 56, 20].map(value => value * ratio);
    const [[a, b], [c, d]] = this.turn, { width: columns, height: rows } = this.doc;
    const across = Math.abs(a) * columns + Math.abs(b) * rows, down = Math.abs(c) * columns + Math.abs(d) * rows;
    const zoom = Math.max(Math.min((width - 2 * beside) / across, (height - above - below) / down), 1e-4);
    // The middle of the free part of the stage lies below or above that of the stage.
    const off = (above - below) / 2 / zoom / (a * d - b * c);
    return [columns / 2 + b * off, rows / 2 - a * off, zoom];
  }

  fit() {
    this.set({ view: null });
  }

  zoomTo(zoom, at = null) {
    const [x, y, before] = this.view;
    const after = Math.min(Math.max(zoom, 0.2 * Math.min(this.canvas.width / this.doc.width, this.canvas.height / this.doc.height, 1)), 64);
    if (!at) return this.set({ view: [x, y, after] });
    const place = this.place(at);
    this.state.view = [x, y, after];
    const moved = this.place(at);
    return this.set({ view: [x + place[0] - moved[0], y + place[1] - moved[1], after] });
  }

  // What an eye at the side makes of columns and rows, its right and down: the painting's up stays up.
  get turn() {
    const [vx, vy, vz] = directionOf(this.state.towards, 90 - this.state.tilt), across = Math.hypot(vx, vz);
    const [right, down] = [this.turned([vz / across, vx * vy / across]), this.turned([0, across])];
    return [[right[0], down[0]], [right[1], down[1]]];
  }

  // A vector, right and down, after the quarter turns of the picture.
  turned([x, y]) {
    for (let i = 0; i < this.state.turns; i++) [x, y] = [y, -x];
    return [x, y];
  }

  // The same angle on the page and on the painting, in degrees.
  onPage(azimuth) {
    return (azimuth + 90 * this.state.turns) % 360;
  }

  onPainting(azimuth) {
    return (azimuth + 360 - 90 * this.state.turns) % 360;
  }

  // From the painting's pixels (rows down) to those of the canvas: two rows of three numbers.
  get projection() {
    const [x, y, zoom] = this.view, { width, height } = this.canvas;
    const [[m, n], [o, p]] = this.turn.map(row => row.map(value => zoom * value));
    return [[m, n, width / 2 - m * x - n * y], [o, p, height / 2 - o * x - p * y]];
  }

  // By how much heights move what an eye at the side sees; null: not at all. Right and up of the eye are
  // (vz, 0, -vx) / a and (-vx vy, a^2, -vy vz) / a with a^2 = vx^2 + vz^2.
  get displacement() {
    const { doc, state } = this;
    if (!state.tilt || !doc.relief || !state.relief) return null;
    const [vx, vy, vz] = directionOf(state.towards, 90 - state.tilt), across = Math.hypot(vx, vz);
    const pixels = state.relief / (doc.pitch ?? 1), scale = 2 * this.view[2] * pixels / across;
    const extent = 2 * Math.hypot(doc.width, doc.height);
    const [right, down] = this.turned([-vx * scale, vy * vz * scale]);
    return {
      shift: [right / this.canvas.width, -down / this.canvas.height],
      depth: [-vx / extent, vy / extent, -vz * pixels / extent],
    };
  }

  toCanvas([x, y]) {
    return this.projection.map(([a, b, c]) => a * x + b * y + c);
  }

  place([x, y]) {
    const [[a, b, c], [d, e, f]] = this.projection, det = a * e - b * d;
    return [(e * (x - c) - b * (y - f)) / det, (a * (y - f) - d * (x - c)) / det];
  }

  goTo([x, y, width, height]) {
    const zoom = Math.min(0.5 * this.canvas.width / width, 0.5 * this.canvas.height / height, 8);
    this.set({ view: [x + width / 2, y + height / 2, zoom] });
  }

  // --- tiles

  sizeOf(name) {
    const [number, row, column] = name.split(/[/-]/).map(Number), { side } = this.doc, scale = this.doc.scales[number];
    return { width: Math.min(side, scale.width - column * side), height: Math.min(side, scale.height - row * side) };
  }

  // The tiles of a scale that are seen, the middle first.
  seen(number) {
    const { width, height } = this.canvas, scale = this.doc.scales[number], side = this.doc.side * scale.factor;
    const corners = [[0, 0], [width, 0], [0, height], [width, height]].map(at => this.place(at));
    const range = (axis, count) => {
      const values = corners.map(corner => corner[axis] / side);
      return [Math.max(0, Math.floor(Math.min(...values))), Math.min(count - 1, Math.floor(Math.max(...values)))];
    };
    const [left, right] = range(0, Math.ceil(scale.width / this.doc.side)), [top, bottom] = range(1, Math.ceil(scale.height / this.doc.side));
    const found = [], middle = this.place([width / 2, height / 2]).map(value => value / side - 0.5);
    for (let row = top; row <= bottom; row++) for (let column = left; column <= right; column++) {
      found.push({ name: `${number}/${row}-${column}`, far: Math.hypot(column - middle[0], row - middle[1]) });
    }
    return found.sort((one, other) => one.far - other.far).map(one => one.name);
  }

  // The scale at which the painting is seen; a moving light is shown more coarsely where it is slow.
  wanted(coarse) {
    const zoom = this.view[2], last = this.doc.scales.length - 1;
    let number = 0;
    while (number < last && this.doc.scales[number + 1].factor * zoom <= 1.42) number++;
    return Math.min(number + coarse, last);
  }

  arrived(name, entry) {
    if (entry.failed) this.say(`A part of the painting could not be loaded (${name}).`);
    else if (!this.renderer.gl.isContextLost()) {
      const { width, height } = this.sizeOf(name);
      this.renderer.upload(name, entry.buffer, width, height);
    }
    this.redraw();
  }

  redraw() {
    // Nothing else is asked for before the first tile is there.
    if (this.frame || !this.started) return;
    this.frame = requestAnimationFrame(now => {
      this.frame = 0;
      this.draw(now);
    });
  }

  draw(now) {
    if (this.renderer.gl.isContextLost()) return;
    if (this.dragging && this.last) {
      const passed = now - this.last;
      if (passed > SLOW && passed < 1000) this.coarse = Math.min(this.coarse + 1, 2);
      else if (passed < QUICK && this.coarse) this.steady = (this.steady ?? 0) + 1;
      if (this.steady > 20) [this.steady, this.coarse] = [0, this.coarse - 1];
    }
    this.last = this.dragging ? now : 0;
    if (this.stale) this.renderer.setState(this.state);
    this.stale = false;
    const last = this.doc.scales.length - 1, whole = name => this.renderer.has(name);
    const finest = this.wanted(0), coarse = this.wanted(this.coarse);
    let number = coarse;
    // Coarser tiles that are not there yet are no reason to show less than is there.
    if (!this.seen(coarse).every(whole)) number = finest;
    const here = this.seen(number), there = here.filter(name => this.renderer.has(name));
    let names = there;
    if (there.length < here.length) {
      // What is not there yet is shown by coarser scales below it.
      for (let coarser = number + 1; coarser <= last; coarser++) {
        const found = this.seen(coarser).filter(name => this.renderer.has(name));
        names = [...found, ...names];
        if (found.length === this.seen(coarser).length) break;
      }
    }
    this.tiles.want([...(this.renderer.has(`${last}/0-0`) ? [] : this.seen(last)), ...here, ...(coarse === number ? [] : this.seen(coarse))]);
    const [[a, b, c], [d, e, f]] = this.projection, { width, height } = this.canvas;
    const clip = [2 * a / width, -2 * d / height, 0, 2 * b / width, -2 * e / height, 0, 2 * c / width - 1, 1 - 2 * f / height, 1];
    this.renderer.draw(names, { clip, zoom: this.view[2], state: this.state, relief: this.displacement });
    for (const gone of this.renderer.trim(new Set([...names, ...here]))) this.tiles.forget(gone);
    if (names.length) {
      this.wait.hidden = true;
      document.documentElement.dataset.shown ??= String(Math.round(performance.now()));
    }
    // Everything that the present view needs is there.
    if (there.length === here.length) document.documentElement.dataset.ready = "true";
    else delete document.documentElement.dataset.ready;
    this.drawOver();
  }

  // --- what lies over the painting

  drawOver() {
    const ratio = this.canvas.width / this.canvas.clientWidth || 1;
    const onPage = place => this.toCanvas(place).map(value => value / ratio);
    const polygon = ([x, y, w, hh], attributes) => svg("polygon", { points: [[x, y], [x + w, y], [x + w, y + hh], [x, y + hh]].map(onPage).join(" "), ...attributes });
    this.over.replaceChildren();
    this.notes.forEach((one, i) => {
      const place = placeOf(one), [x, y] = onPage(place);
      this.over.append(polygon(place, { class: "note" }), svg("text", { x: x + 4, y: y - 5, class: "number" }, String(i + 1)));
    });
    if (this.drawn) this.over.append(polygon(this.drawn, { class: "note" }));
    if (this.state.pixel) {
      const [x, y] = onPage(this.state.pixel.map(value => value + 0.5));
      for (const name of ["halo", "cross"]) this.over.append(svg("path", { d: `M${x - 11} ${y}h7m8 0h7M${x} ${y - 11}v7m0 8v7`, class: name }));
    }
    this.divider.hidden = this.state.photograph < 0 || this.state.layer !== "picture";
    this.divider.style.left = `${100 * this.state.split}%`;
    this.divider.setAttribute("aria-valuenow", Math.round(100 * this.state.split));
    this.drawScale(ratio);
  }

  drawScale(ratio) {
    if (!this.doc.pitch) return;
    const perPixel = this.doc.pitch * ratio / this.view[2], widest = 140 * perPixel;
    const decade = 10 ** Math.floor(Math.log10(widest));
    const length = [5, 2, 1].find(step => step * decade <= widest) * decade;
    const [value, unit] = length >= 1000 ? [length / 1000, "m"] : length >= 10 ? [length / 10, "cm"] : length >= 1 ? [length, "mm"] : [1000 * length, "µm"];
    this.scaleBar.textContent = `${Number(value.toPrecision(3))} ${unit}`;
    this.scaleBar.style.width = `${length / perPixel}px`;
  }

  // --- pointer and keys

  choose(tool) {
    this.tool = tool;
    TOOLS.forEach(([name], i) => this.buttons[i].setAttribute("aria-pressed", String(name === tool)));
    this.canvas.dataset.tool = tool;
  }

  moving(on) {
    this.dragging = on;
    if (!on) {
      this.coarse = 0;
      this.redraw();
    }
  }

  at(event) {
    const box = this.canvas.getBoundingClientRect(), ratio = this.canvas.width / box.width;
    return [(event.clientX - box.left) * ratio, (event.clientY - box.top) * ratio];
  }

  // The light by where the pointer is on the canvas: its middle is in front, the nearer edge grazes.
  lightByPointer([x, y]) {
    const { width, height } = this.canvas, reach = 0.48 * Math.min(width, height);
    this.lightAt((x - width / 2) / reach, (height / 2 - y) / reach);
  }

  listen() {
    const { canvas } = this;
    new ResizeObserver(() => this.resize()).observe(this.stage);
    this.resize();
    canvas.addEventListener("pointerdown", event => this.down(event));
    canvas.addEventListener("pointermove", event => this.move(event));
    for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, event => this.up(event));
    canvas.addEventListener("contextmenu", event => event.preventDefault());
    canvas.addEventListener("wheel", event => {
      event.preventDefault();
      const lines = event.deltaMode === 1 ? 16 : 1;
      this.zoomTo(this.view[2] * 2 ** (-event.deltaY * lines / (event.ctrlKey ? 80 : 320)), this.at(event));
    }, { passive: false });
    canvas.addEventListener("webglcontextlost", event => event.preventDefault());
    canvas.addEventListener("webglcontextrestored", () => this.restored());
    this.divider.addEventListener("pointerdown", event => this.divider.setPointerCapture(event.pointerId));
    this.divider.addEventListener("pointermove", event => this.divider.hasPointerCapture(event.pointerId) && this.set({ split: Math.min(Math.max(this.at(event)[0] / canvas.width, 0), 1) }));
    this.divider.addEventListener("keydown", event => {
      const step = { ArrowLeft: -0.02, ArrowRight: 0.02 }[event.key];
      if (step) {
        event.preventDefault();
        event.stopPropagation();
        this.set({ split: Math.min(Math.max(this.state.split + step, 0), 1) });
      }
    });
    window.addEventListener("hashchange", () => {
      if (location.hash === this.linked) return;
      this.state = stateOfText(location.hash, this.doc);
      this.changed();
      if (this.state.photograph >= 0) this.compareWith(this.state.photograph);
      if (this.state.pixel) this.inspect(...this.state.pixel);
    });
    this.element.addEventListener("keydown", event => this.key(event));
  }

  resize() {
    const ratio = Math.min(window.devicePixelRatio || 1, 2), box = this.stage.getBoundingClientRect();
    const [width, height] = [Math.max(1, Math.round(box.width * ratio)), Math.max(1, Math.round(box.height * ratio))];
    if (this.canvas.width === width && this.canvas.height === height) return;
    [this.canvas.width, this.canvas.height] = [width, height];
    this.redraw();
  }

  restored() {
    this.renderer.restart();
    this.stale = true;
    for (const [name, entry] of this.tiles.known) if (entry.buffer) this.arrived(name, entry);
    if (this.state.photograph >= 0) this.compareWith(this.state.photograph);
  }

  down(event) {
    this.canvas.focus({ preventScroll: true });
    this.canvas.setPointerCapture(event.pointerId);
    this.pointers.set(event.pointerId, this.at(event));
    if (this.pointers.size > 1) {
      this.action = "pinch";
      this.drawn = null;
      return;
    }
    const pan = event.button === 1 || event.button === 2 || event.shiftKey;
    this.action = pan ? "move" : this.tool;
    this.from = this.at(event);
    if (this.action === "light") {
      this.moving(true);
      this.lightByPointer(this.from);
    }
    if (this.action === "inspect") this.inspectAt(this.from);
  }

  move(event) {
    if (!this.pointers.has(event.pointerId)) return;
    const before = this.pointers.get(event.pointerId), now = this.at(event);
    if (this.action === "pinch" && this.pointers.size === 2) {
      const other = [...this.pointers].find(([id]) => id !== event.pointerId)[1];
      const far = point => Math.hypot(point[0] - other[0], point[1] - other[1]);
      const middle = [(now[0] + other[0]) / 2, (now[1] + other[1]) / 2], was = [(before[0] + other[0]) / 2, (before[1] + other[1]) / 2];
      this.pan(was, middle);
      this.zoomTo(this.view[2] * far(now) / Math.max(far(before), 1), middle);
    }
    if (this.action === "move") this.pan(before, now);
    if (this.action === "light") this.lightByPointer(now);
    if (this.action === "inspect") this.inspectAt(now);
    if (this.action === "note") {
      const [a, b] = [this.place(this.from), this.place(now)];
      this.drawn = this.inside([Math.min(a[0], b[0]), Math.min(a[1], b[1]), Math.abs(a[0] - b[0]), Math.abs(a[1] - b[1])]);
      this.measure(this.drawn);
      this.redraw();
    }
    this.pointers.set(event.pointerId, now);
  }

  up(event) {
    this.pointers.delete(event.pointerId);
    if (this.action === "light") this.moving(false);
    if (this.action === "note" && this.drawn) this.askNote(this.drawn);
    if (!this.pointers.size) this.action = null;
  }

  pan(before, now) {
    const [a, b] = [this.place(before), this.place(now)], [x, y, zoom] = this.view;
    this.set({ view: [x + a[0] - b[0], y + a[1] - b[1], zoom] });
  }

  // The size of a rectangle that is drawn: a ruler.
  measure([, , width, height]) {
    const { pitch } = this.doc, words = value => (pitch ? `${(value * pitch).toPrecision(3)} mm` : `${Math.round(value)} pixels`);
    this.readout.textContent = `${words(width)} wide, ${words(height)} high, ${words(Math.hypot(width, height))} across`;
  }

  inside([x, y, width, height]) {
    const left = Math.min(Math.max(x, 0), this.doc.width - 1), top = Math.min(Math.max(y, 0), this.doc.height - 1);
    return [left, top, Math.max(1, Math.min(width, this.doc.width - left)), Math.max(1, Math.min(height, this.doc.height - top))];
  }

  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey || /^(input|textarea|select)$/i.test(event.target.tagName)) return;
    if (event.target === this.canvas && this.lightKey(event)) return;
    const acts = {
      "+": () => this.zoomTo(1.25 * this.view[2]), "=": () => this.zoomTo(1.25 * this.view[2]), "-": () => this.zoomTo(this.view[2] / 1.25),
      0: () => this.fit(), 1: () => this.zoomTo(1), h: () => this.togglePanel(), t: () => this.turn90(), p: () => this.copyLink(), s: () => this.savePicture(),
      r: () => this.set({ azimuth: this.state.elevation <= 12 ? (this.state.azimuth + 45) % 360 : this.onPainting(180), elevation: 10, exposure: RAKING_STOPS, photograph: -1 }),
      ...Object.fromEntries(TOOLS.map(([name, , key]) => [key.toLowerCase(), () => this.choose(name)])),
    };
    const act = acts[event.key.toLowerCase()];
    if (!act) return;
    event.preventDefault();
    act();
  }

  // --- what is asked for

  inspectAt(at) {
    const [x, y] = this.place(at).map(Math.floor);
    if (x >= 0 && y >= 0 && x < this.doc.width && y < this.doc.height) this.inspect(x, y);
  }

  async inspect(x, y) {
    this.set({ pixel: [x, y] });
    const { side } = this.doc, name = `0/${Math.floor(y / side)}-${Math.floor(x / side)}`;
    const buffer = await this.tiles.get(name);
    const [column, row] = this.state.pixel ?? [];
    if (!buffer || column !== x || row !== y) return;
    this.showPixel([x, y], pixelValues(this.doc, buffer, this.sizeOf(name), x % side, y % side));
  }

  compareWith(number) {
    this.set({ photograph: number, ...(number >= 0 ? { layer: "picture", tilt: 0 } : {}) });
    if (number < 0 || this.renderer.photographs.has(number)) return;
    this.source.photograph(number).then(image => {
      this.renderer.photograph(number, image);
      this.redraw();
    }, () => this.say("The photograph could not be loaded."));
  }

  askNote(place) {
    const dialog = noteDialog(text => {
      if (text) this.notes.push(note(place, text, location.href.split("#")[0]));
      this.drawn = null;
      if (text) this.notesChanged();
      this.changed();
    });
    this.element.append(dialog);
    dialog.showModal();
  }

  notesChanged() {
    this.showNotes(this.notes, storeAnnotations(this.doc, this.notes));
    this.redraw();
  }

  removeNote(index) {
    this.notes.splice(index, 1);
    this.notesChanged();
  }

  async openNotes(file) {
    let content;
    try {
      content = JSON.parse(await file.text());
    } catch {
      return this.say("The file is no JSON.");
    }
    const found = annotationsOf(content, this.doc);
    if (!found.length) return this.say("The file holds no notes on this painting.");
    const known = new Set(this.notes.map(one => one.id));
    this.notes.push(...found.filter(one => !known.has(one.id)));
    return this.notesChanged();
  }

  saveNotes() {
    download(new Blob([JSON.stringify(annotationPage(this.notes), null, 2)], { type: "application/ld+json" }), "notes.jsonld");
  }

  async copyLink() {
    this.link();
    const address = location.href.split("#")[0] + this.linked;
    try {
      await navigator.clipboard.writeText(address);
      this.say("The link is copied.");
    } catch {
      this.say(`Copy the address of this page: ${address}`);
    }
  }

  // All of the painting at a scale, as it is lit now, seen from in front.
  async picture(number) {
    const scale = this.doc.scales[number], { side } = this.doc, data = new ImageData(scale.width, scale.height);
    for (let row = 0; row * side < scale.height; row++) for (let column = 0; column * side < scale.width; column++) {
      const name = `${number}/${row}-${column}`, { width, height } = this.sizeOf(name);
      const buffer = await this.tiles.get(name);
      if (!buffer) throw new Error("A part of the painting could not be loaded.");
      if (!this.renderer.has(name)) this.renderer.upload(name, buffer, width, height);
      if (this.stale) this.renderer.setState(this.state);
      this.stale = false;
      const codes = this.renderer.codes(name);
      for (let y = 0; y < height; y++) data.data.set(codes.subarray(4 * y * width, 4 * (y + 1) * width), 4 * ((row * side + y) * scale.width + column * side));
      for (const gone of this.renderer.trim(new Set([name]))) this.tiles.forget(gone);
    }
    return data;
  }

  async savePicture() {
    const number = this.doc.scales.findIndex(scale => scale.width * scale.height <= LARGEST_PICTURE);
    this.say("Making the picture");
    try {
      const canvas = await upright(await this.picture(number), this.state.turns);
      canvas.toBlob(blob => {
        if (!blob) return this.say("The picture is too large for this browser.");
        download(blob, `${(this.doc.title || "painting").replace(/[^\p{L}\p{N}]+/gu, "-")}.png`);
        return this.say(number ? `Saved at 1/${this.doc.scales[number].factor} of its size.` : "Saved.");
      });
    } catch (error) {
      this.say(error.message);
    }
  }
}
