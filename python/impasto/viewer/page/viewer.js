// A painting in an element: its state, its tiles, and what is drawn when.

import { Tiles } from "./tiles.js";
import { Renderer } from "./renderer.js";
import { Geometry } from "./geometry.js";
import { Pointer, TOOLS } from "./pointer.js";
import { pixelValues, rangesOf } from "./values.js";
import { svg } from "./plots.js";
import { EnvironmentMap } from "./environment.js";
import { exr } from "./exr.js";
import { annotationPage, annotationsOf, note, placeOf } from "./annotations.js";
import { h } from "./elements.js";
import { anglesFromPlane, lightWords, panel, roomWords } from "./controls.js";
import { download, noteDialog, upright } from "./saving.js";
import { directionOf, firstState, layersOf, stateOfText, textOfState } from "./state.js";

const FORMAT = 1;
const LARGEST_PICTURE = 1 << 26; // pixels of a PNG
const SHARES = [1, 0.71, 0.5, 0.35]; // of the pixels along a side, while something moves
const ROUGH = 0.35; // of them, until what takes longer than a frame is lit
const SLOW = 55, QUICK = 24; // ms that a frame takes from which on there are fewer, up to which there are more
const CALM = 40; // ms without a change until what moved is drawn with all
const REST = 120; // ms for which a pixel is looked at before its samples are asked for
const LATE = 10000; // ms until a reader is told that they do not come
const HIDDEN = 250; // ms until it is tried again to draw what has no size

export class Viewer extends Geometry {
  constructor(element, doc, source, host) {
    super();
    if (doc.format !== FORMAT) throw new Error(`the painting has the format ${doc.format}, this page shows ${FORMAT}`);
    Object.assign(this, { element, doc, source, host, size: { width: 1, height: 1 }, coarse: 0, quick: 0, trust: 20, moves: false, notes: host.notes(), statuses: [], first: firstState(doc), pointer: new Pointer(this) });
    this.build();
    this.renderer = new Renderer(this.canvas, doc);
    this.tiles = new Tiles(source, (name, entry) => this.arrived(name, entry, this.renderer));
    if (doc.against) {
      this.other = new Renderer(this.canvas, doc.against);
      this.otherTiles = new Tiles(source, (name, entry) => this.arrived(name, entry, this.other), "against/");
    }
    this.panel = panel(this);
    this.panel.element.addEventListener("input", () => this.stir(), true);
    this.element.append(this.panel.element);
    this.state = stateOfText(host.read(), doc);
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
      const { ranges, statuses, known } = rangesOf(this.doc, buffer, this.sizeOf(name));
      Object.assign(this.renderer.ranges, ranges);
      this.statuses = statuses;
      this.unknown = !known;
      const why = statuses.map(code => this.doc.statuses[code].reason);
      if (this.unknown) this.wait.textContent = `No pixel of this painting has an estimate${why.length ? `: ${why.join("; ")}` : ""}. There is no picture to light; the layer of statuses shows where which holds.`;
    }
    this.showNotes(this.notes, true);
    this.reached();
  }

  // A state from outside: what it shows is loaded.
  reached() {
    this.changed();
    if (this.state.photograph >= 0) this.compareWith(this.state.photograph);
    if (this.state.pixel) this.inspect(...this.state.pixel);
  }


  build() {
    const { doc } = this, title = doc.title || "A painting";
    this.host.title(doc.title ? `${doc.title} – impasto` : "impasto");
    this.canvas = h("canvas", { tabIndex: 0, role: "application", "aria-label": `${title}, ${doc.width} by ${doc.height} pixels. Arrows move the light; the panel has all controls.` });
    this.over = svg("svg", { class: "over", "aria-hidden": "true" });
    this.buttons = TOOLS.map(([name, label, key, title]) => h("button", { type: "button", title: `${title} (${key})`, "aria-pressed": "false", onclick: () => this.choose(name) }, label));
    this.readout = h("output", { className: "readout", "aria-live": "polite" });
    this.scaleBar = h("div", { className: "scale", hidden: !doc.pitch });
    this.sides = ["left", "right"].map(side => h("b", { className: side, "aria-hidden": "true" }));
    this.divider = h("div", { className: "divider", role: "slider", tabIndex: 0, hidden: true, "aria-label": "Line between picture and photograph", "aria-valuemin": 0, "aria-valuemax": 100 }, h("span"), ...this.sides);
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
    this.environment();
    this.panel.update(this.state);
    this.readout.textContent = this.state.photograph >= 0 ? `The lamp of photograph no. ${this.doc.photographs[this.state.photograph].number + 1}` : this.state.environment !== "none" ? roomWords(this.doc, this.state) : lightWords(this.onPage(this.state.azimuth), this.state.elevation);
    this.redraw();
    clearTimeout(this.linking);
    this.linking = setTimeout(() => this.link(), 250);
  }

  // The environment of the state, loaded when it is first needed.
  environment() {
    const number = this.doc.environments.findIndex(one => one.name === this.state.environment);
    if (number < 0) return Promise.resolve(null);
    const record = this.doc.environments[number];
    this.maps ??= new Map();
    if (!this.maps.has(number)) {
      const loaded = this.source.environment(number).then(buffer => EnvironmentMap.read(record, buffer)).then(map => {
        this.renderer.environments.set(record.name, map);
        this.changed();
      });
      this.maps.set(number, loaded);
      loaded.catch(error => {
        this.maps.delete(number);
        console.error(error);
        this.set({ environment: "none" });
        this.say("The environment could not be loaded.");
      });
    }
    return this.maps.get(number);
  }

  rotate(degrees) {
    this.stir();
    this.set({ rotation: ((this.state.rotation + degrees) % 360 + 360) % 360 });
  }

  link() {
    const text = textOfState(this.state, this.doc);
    this.host.write(text);
    return text;
  }

  // By a place in the unit circle of the page: right and up.
  lightAt(x, y) {
    const { azimuth, elevation } = anglesFromPlane(x, y);
    this.stir();
    this.set({ azimuth: this.onPainting(azimuth), elevation, photograph: -1, environment: "none" });
  }

  turn90() {
    this.set({ turns: (this.state.turns + 1) % 4, view: null });
  }

  lightKey(event) {
    const step = event.shiftKey ? 1 : 5, { azimuth, elevation } = this.state;
    const around = { ArrowLeft: -step, ArrowRight: step }[event.key];
    if (this.state.environment !== "none" && around) {
      event.preventDefault();
      event.stopPropagation();
      this.rotate(around);
      return true;
    }
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

  // The renderer of the other painting, while it is shown beside.
  get beside() {
    const { against, layer } = this.state;
    return against && layersOf(this.doc.against).some(one => one.name === layer) ? this.other : null;
  }

  // --- tiles

  sizeOf(name) {
    const [number, row, column] = name.split(/[/-]/).map(Number), { side } = this.doc, scale = this.doc.scales[number];
    return { width: Math.min(side, scale.width - column * side), height: Math.min(side, scale.height - row * side) };
  }

  // The tiles of a scale that are seen, the middle first.
  seen(number) {
    const { width, height } = this.size, scale = this.doc.scales[number], side = this.doc.side * scale.factor;
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

  // The scale at which the painting is seen with a share of the pixels.
  wanted(share = 1) {
    const zoom = this.view[2] * share, last = this.doc.scales.length - 1;
    let number = 0;
    while (number < last && this.doc.scales[number + 1].factor * zoom <= 1.42) number++;
    return number;
  }

  arrived(name, entry, renderer) {
    if (entry.failed) this.say(`A part of the painting could not be loaded (${name}).`);
    else if (!this.renderer.gl.isContextLost()) {
      const { width, height } = this.sizeOf(name);
      renderer.upload(name, entry.buffer, width, height);
    }
    this.redraw();
  }

  redraw() {
    // Nothing else is asked for before the first tile is there.
    if (this.frame || !this.started) return;
    this.waiting = performance.now();
    this.frame = requestAnimationFrame(now => {
      this.frame = 0;
      this.draw(now, true);
    });
  }

  // `paced`: what takes longer than a frame is lit in the next ones.
  draw(now, paced = false) {
    if (this.renderer.gl.isContextLost()) return;
    // A notebook hides an output for a while, sometimes within a frame, which no observer is told.
    if (!this.canvas.clientWidth) {
      clearTimeout(this.hidden);
      this.hidden = setTimeout(() => this.redraw(), HIDDEN);
      return;
    }
    if (this.moves && this.last) this.adapt(now - Math.max(this.last, this.waiting));
    this.last = this.moves ? now : 0;
    // Layers of both paintings are shown on the same ramps.
    const other = this.beside;
    if (other) other.ranges = this.renderer.ranges;
    if (this.stale) for (const one of [this.renderer, other]) one?.setState(this.state);
    this.stale = false;
    const last = this.doc.scales.length - 1, whole = name => this.renderer.has(name), fine = this.seen(this.wanted()).filter(whole);
    // What takes longer than a frame is shown coarsely at first, also while there are no tables of the room yet.
    const early = this.renderer.prefilter?.next() === "moving", rough = paced && !this.moves && (early || !this.renderer.quick(fine));
    const share = this.moves ? SHARES[this.coarse] : rough ? ROUGH : 1;
    this.fitCanvas(share);
    const coarse = this.wanted(share);
    let number = coarse;
    // Coarser tiles that are not there yet are no reason to show less than is there, unless that takes long.
    if (rough) while (number < last && !this.seen(number).every(whole)) number++;
    else if (!this.seen(coarse).every(whole)) number = this.wanted();
    const here = this.seen(number), there = here.filter(whole);
    let names = there;
    if (there.length < here.length) {
      // What is not there yet is shown by coarser scales below it.
      for (let coarser = number + 1; coarser <= last; coarser++) {
        const found = this.seen(coarser).filter(whole);
        names = [...found, ...names];
        if (found.length === this.seen(coarser).length) break;
      }
    }
    this.tiles.want([...(whole(`${last}/0-0`) ? [] : this.seen(last)), ...here, ...(coarse === number ? [] : this.seen(coarse))]);
    const [[a, b, c], [d, e, f]] = this.projection, { width, height } = this.size;
    const clip = [2 * a / width, -2 * d / height, 0, 2 * b / width, -2 * e / height, 0, 2 * c / width - 1, 1 - 2 * f / height, 1];
    this.renderer.draw(names, { clip, zoom: this.view[2] * share, state: this.state, relief: this.displacement, other });
    if (other) {
      this.otherTiles.want([...here, ...names].filter(name => !other.has(name)));
      for (const gone of other.trim(new Set([...names, ...here]))) this.otherTiles.forget(gone);
    }
    for (const gone of this.renderer.trim(new Set([...names, ...here]))) this.tiles.forget(gone);
    if (names.length) this.wait.hidden = !this.unknown || this.state.layer === "status";
    const refining = rough || Boolean(this.renderer.prefilter?.busy);
    this.fine = rough && !early ? fine : [];
    if (refining) this.refine();
    if (names.length) this.host.shown(!refining && there.length === here.length && (!other || here.every(name => other.has(name))));
    this.drawOver();
  }

  // Between frames, part by part: the tiles of a picture that is shown coarsely, then the tables of a room.
  refine() {
    this.refining ||= requestAnimationFrame(() => {
      this.refining = 0;
      const { renderer } = this, { prefilter } = renderer;
      if (renderer.gl.isContextLost()) return;
      const dark = renderer.dark(this.fine);
      if (dark.length) renderer.lightSome(dark);
      else if (prefilter) {
        prefilter.moving = this.moves;
        this.stale = prefilter.step() || this.stale;
      }
      const left = renderer.dark(this.fine).length;
      if (!this.stale && (left || (!dark.length && prefilter?.busy))) this.refine();
      else this.redraw();
    });
  }

  // Fewer pixels where a frame takes long. More again after some quick ones, and more of these each time it was too early.
  adapt(took) {
    this.quick = took < QUICK ? this.quick + 1 : 0;
    if (took > SLOW && this.coarse < SHARES.length - 1) {
      this.coarse++;
      this.trust *= 2;
    } else if (this.coarse && this.quick > this.trust) [this.quick, this.coarse] = [0, this.coarse - 1];
  }

  fitCanvas(share) {
    const { canvas } = this, [width, height] = [this.size.width, this.size.height].map(value => Math.max(1, Math.round(value * share)));
    if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
  }

  // Something is moved by hand: it is quick now, and drawn with all pixels when it rests.
  stir() {
    // Where not all is lit within a frame, it is not while it moves either.
    if (!this.moves && this.seen(this.wanted()).length * this.doc.side ** 2 > this.renderer.pacer.amount) this.coarse ||= 2;
    this.moves = true;
    clearTimeout(this.calming);
    this.calming = setTimeout(() => this.rest(), CALM);
  }

  rest() {
    clearTimeout(this.calming);
    this.moves = false;
    if (this.state.environment !== "none") this.panel.update(this.state);
    this.redraw();
  }

  // --- what lies over the painting

  drawOver() {
    const { doc, ratio } = this;
    const onPage = place => this.toCanvas(place).map(value => value / ratio);
    const polygon = ([x, y, w, hh], attributes) => svg("polygon", { points: [[x, y], [x + w, y], [x + w, y + hh], [x, y + hh]].map(onPage).join(" "), ...attributes });
    this.over.replaceChildren();
    this.notes.forEach((one, i) => {
      const place = placeOf(one), [x, y] = onPage(place);
      this.over.append(polygon(place, { class: "note" }), svg("text", { x: x + 4, y: y - 5, class: "number" }, String(i + 1)));
    });
    if (this.pointer.drawn) this.over.append(polygon(this.pointer.drawn, { class: "note" }));
    if (this.state.pixel) {
      const [x, y] = onPage(this.state.pixel.map(value => value + 0.5));
      for (const name of ["halo", "cross"]) this.over.append(svg("path", { d: `M${x - 11} ${y}h7m8 0h7M${x} ${y - 11}v7m0 8v7`, class: name }));
    }
    this.divider.hidden = !this.beside && (this.state.photograph < 0 || this.state.layer !== "picture");
    const [left, right] = this.sides, photograph = doc.photographs[this.state.photograph];
    left.textContent = doc.title || "The picture";
    right.textContent = this.state.layer === "picture" && this.state.compare === "difference" ? "Difference" : photograph ? `Photograph no. ${photograph.number + 1}` : doc.against?.title || "The other painting";
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

  // --- the page around it

  listen() {
    this.watch = new ResizeObserver(() => this.resize());
    this.watch.observe(this.stage);
    this.resize();
    this.canvas.addEventListener("webglcontextlost", event => event.preventDefault());
    this.canvas.addEventListener("webglcontextrestored", () => this.restored());
    this.pointer.listen();
    this.host.changed(() => {
      this.state = stateOfText(this.host.read(), this.doc);
      this.reached();
    });
  }

  // What the browser keeps for a painting that is no longer shown is given back.
  close() {
    for (const timer of [this.linking, this.hidden, this.sampling, this.calming]) clearTimeout(timer);
    for (const frame of [this.frame, this.refining]) cancelAnimationFrame(frame);
    this.watch.disconnect();
    this.renderer.gl.getExtension("WEBGL_lose_context")?.loseContext();
  }

  choose(tool) {
    this.pointer.tool = tool;
    TOOLS.forEach(([name], i) => this.buttons[i].setAttribute("aria-pressed", String(name === tool)));
    this.canvas.dataset.tool = tool;
  }

  resize() {
    const ratio = Math.min(window.devicePixelRatio || 1, 2), box = this.stage.getBoundingClientRect();
    if (!box.width || !box.height) return;
    this.size = { width: Math.max(1, Math.round(box.width * ratio)), height: Math.max(1, Math.round(box.height * ratio)) };
    if (!this.moves) this.fitCanvas(1);
    this.redraw();
  }

  restored() {
    this.stale = true;
    for (const [tiles, renderer] of [[this.tiles, this.renderer], [this.otherTiles, this.other]]) {
      renderer?.restart();
      for (const [name, entry] of tiles?.known ?? []) if (entry.buffer) this.arrived(name, entry, renderer);
    }
    if (this.state.photograph >= 0) this.compareWith(this.state.photograph);
  }

  // The size of a rectangle that is drawn: a ruler.
  measure([, , width, height]) {
    const { pitch } = this.doc, words = value => (pitch ? `${(value * pitch).toPrecision(3)} mm` : `${Math.round(value)} pixels`);
    this.readout.textContent = `${words(width)} wide, ${words(height)} high, ${words(Math.hypot(width, height))} across`;
  }

  // --- what is asked for

  async inspect(x, y) {
    this.set({ pixel: [x, y] });
    const { side } = this.doc, name = `0/${Math.floor(y / side)}-${Math.floor(x / side)}`;
    const buffer = await this.tiles.get(name);
    const [column, row] = this.state.pixel ?? [];
    if (!buffer || column !== x || row !== y) return;
    // A link may name a pixel before anything was drawn.
    if (!this.renderer.colours) this.renderer.setState(this.state);
    this.showPixel([x, y], pixelValues(this.doc, buffer, this.sizeOf(name), x % side, y % side));
    clearTimeout(this.sampling);
    if (this.doc.samples) this.sampling = setTimeout(() => this.sample(x, y), REST);
  }

  // What was measured at a pixel, if it is still the one that is looked at.
  async sample(x, y) {
    const late = new Promise((_, reject) => setTimeout(reject, LATE, new Error("Python does not answer"))), asked = this.asked = {};
    const found = await Promise.race([this.source.samples(y, x), late]).catch(error => ({ failed: `The samples could not be read: ${error.message}.` }));
    if (this.asked === asked && this.state.pixel?.join() === `${x},${y}`) this.showSamples(found);
  }

  // The pixel beside the one that is looked at, by an arrow; the first one is in the middle of the view.
  inspectKey(event) {
    const move = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
    if (!move) return false;
    event.preventDefault();
    event.stopPropagation();
    const { width, height } = this.doc, step = event.shiftKey ? 10 : 1, { pixel, turns } = this.state;
    const along = Array.from({ length: turns }).reduce(([right, down]) => [-down, right], move);
    const [x, y] = pixel ? [0, 1].map(i => pixel[i] + step * along[i]) : this.place([this.size.width / 2, this.size.height / 2]).map(Math.floor);
    this.inspect(Math.min(Math.max(x, 0), width - 1), Math.min(Math.max(y, 0), height - 1));
    return true;
  }

  // A photograph by its number, the other painting, or nothing.
  compareWith(number, against = false) {
    this.set({ photograph: number, against, ...(number >= 0 ? { layer: "picture", tilt: 0, environment: "none" } : {}) });
    if (number < 0 || this.renderer.photographs.has(number)) return;
    this.source.photograph(number).then(image => {
      this.renderer.photograph(number, image);
      this.redraw();
    }, () => this.say("The photograph could not be loaded."));
  }

  askNote(place) {
    const dialog = noteDialog(text => {
      if (text) this.notes.push(note(place, text, this.host.source()));
      this.pointer.drawn = null;
      if (text) this.notesChanged();
      this.changed();
    });
    this.element.append(dialog);
    dialog.showModal();
  }

  notesChanged() {
    this.showNotes(this.notes, this.host.keepNotes(this.notes));
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
    const text = this.link();
    if (!this.host.link) return;
    const address = this.host.link(text);
    try {
      await navigator.clipboard.writeText(address);
      this.say("The link is copied.");
    } catch {
      this.say(`Copy the address of this page: ${address}`);
    }
  }

  // All of the painting at a scale, as it is lit now, seen from in front.
  async picture(number, changes = {}, quality = "saved") {
    const { width, height } = this.doc.scales[number], data = new ImageData(width, height);
    await this.fill(data.data, number, changes, name => this.renderer.codes(name), quality);
    return data;
  }

  // The same in linear light, `(y, x, 4)`; 1 is the display's white.
  async linear(number) {
    const { width, height } = this.doc.scales[number], light = new Float32Array(4 * width * height);
    await this.fill(light, number, { layer: "picture", clipped: false, photograph: -1 }, name => this.renderer.linear(name), "saved", true);
    return light;
  }

  // Fills an array `(y, x, 4)` with a scale, tile by tile.
  async fill(data, number, changes, read, quality, linear = false) {
    await this.environment();
    const scale = this.doc.scales[number], { side } = this.doc;
    for (let row = 0; row * side < scale.height; row++) for (let column = 0; column * side < scale.width; column++) {
      const name = `${number}/${row}-${column}`, { width, height } = this.sizeOf(name);
      const buffer = await this.tiles.get(name);
      if (!buffer) throw new Error("A part of the painting could not be loaded.");
      if (!this.renderer.has(name)) this.renderer.upload(name, buffer, width, height);
      this.renderer.setState({ ...this.state, ...changes }, quality, linear);
      const codes = read(name);
      for (let y = 0; y < height; y++) data.set(codes.subarray(4 * y * width, 4 * (y + 1) * width), 4 * ((row * side + y) * scale.width + column * side));
      for (const gone of this.renderer.trim(new Set([name]))) this.tiles.forget(gone);
    }
    this.stale = true;
  }

  // As PNG, or in linear light as EXR.
  async savePicture(kind = "png") {
    const most = kind === "png" ? LARGEST_PICTURE : LARGEST_PICTURE / 4;
    const number = this.doc.scales.findIndex(scale => scale.width * scale.height <= most);
    this.say("Making the picture");
    try {
      const made = kind === "png" ? await upright(await this.picture(number, { clipped: false }), this.state.turns) : exr(await this.linear(number), this.doc.scales[number], this.state.turns);
      const blob = kind === "png" ? await new Promise(done => made.toBlob(done)) : made;
      if (!blob) return this.say("The picture is too large for this browser.");
      download(blob, `${(this.doc.title || "painting").replace(/[^\p{L}\p{N}]+/gu, "-")}.${kind}`);
      return this.say(number ? `Saved at 1/${this.doc.scales[number].factor} of its size.` : "Saved.");
    } catch (error) {
      this.say(error.message);
    }
  }
}
