// A painting in an element: its state, its tiles, and what is drawn when.

import { clamp } from "./numbers.js";
import { Tiles } from "./tiles.js";
import { Renderer } from "./renderer.js";
import { Drawing } from "./drawing.js";
import { Pointer, TOOLS } from "./pointer.js";
import { pixelValues, rangesOf } from "./values.js";
import { svg } from "./plots.js";
import { EnvironmentMap } from "./environment.js";
import { exr } from "./exr.js";
import { annotationPage, annotationsOf, note } from "./annotations.js";
import { ARROWS, button, h, taken } from "./elements.js";
import { anglesFromPlane, lightWords, panel, roomWords } from "./controls.js";
import { download, noteDialog, upright } from "./saving.js";
import { directionOf, firstState, stateOfText, textOfState } from "./state.js";

const FORMAT = 1;
const LARGEST_PICTURE = 1 << 26; // pixels of a PNG
const REST = 120; // ms for which a pixel is looked at before its samples are asked for
const RAKING_STOPS = 2.5; // light at 10 degrees gives a flat painting 1 / 5.8 of what it gives in front
const LATE = 10000; // ms until a reader is told that they do not come

export class Viewer extends Drawing {
  constructor(element, doc, source, host) {
    super();
    if (doc.format !== FORMAT) throw new Error(`the painting has the format ${doc.format}, this page shows ${FORMAT}`);
    Object.assign(this, { element, doc, source, host, notes: host.notes(), statuses: [], first: firstState(doc), pointer: new Pointer(this) });
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
    else this.showPixel();
  }


  build() {
    const { doc } = this, title = doc.title || "A painting";
    this.host.title(doc.title ? `${doc.title} – impasto` : "impasto");
    this.canvas = h("canvas", { tabIndex: 0, role: "application", "aria-label": `${title}, ${doc.width} by ${doc.height} pixels. Arrows move the light; the panel has all controls.` });
    this.over = svg("svg", { class: "over", "aria-hidden": "true" });
    this.buttons = TOOLS.map(([name, label, key, title]) => button(label, () => this.choose(name), { title: `${title} (${key})`, "aria-pressed": "false" }));
    this.readout = h("output", { className: "readout", "aria-live": "polite" });
    this.scaleBar = h("div", { className: "scale", hidden: !doc.pitch });
    this.sides = ["left", "right"].map(side => h("b", { className: side, "aria-hidden": "true" }));
    this.divider = h("div", { className: "divider", role: "slider", tabIndex: 0, hidden: true, "aria-label": "Line between picture and photograph", "aria-valuemin": 0, "aria-valuemax": 100 }, h("span"), ...this.sides);
    this.wait = h("p", { className: "wait", role: "status" }, "Loading");
    this.stage = h("div", { className: "stage" }, this.canvas, this.over, this.divider, this.wait,
      h("header", {}, h("h1", {}, title), h("div", { className: "row tools", role: "toolbar", "aria-label": "What dragging does" }, ...this.buttons),
        button("☰", () => this.togglePanel(), { className: "toggle", title: "Hide or show the controls (H)", "aria-label": "Controls" })),
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

  // The lamp far away, by its angles on the page.
  lamp(azimuth, elevation) {
    this.set({ azimuth: this.onPainting(azimuth), elevation, exposure: elevation < 20 ? RAKING_STOPS : 0, photograph: -1, environment: "none" });
  }

  turn90() {
    this.set({ turns: (this.state.turns + 1) % 4, view: null });
  }

  lightKey(event) {
    const step = event.shiftKey ? 1 : 5, { azimuth, elevation, environment } = this.state, move = ARROWS[event.key];
    if (!move) return false;
    taken(event);
    if (environment !== "none") this.rotate(step * move[0]);
    else {
      const at = directionOf(this.onPage(azimuth), elevation);
      this.lightAt(...move.map((value, i) => at[i] + step * Math.PI / 180 * value));
    }
    return true;
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
    if (!ARROWS[event.key]) return false;
    taken(event);
    const move = [ARROWS[event.key][0], -ARROWS[event.key][1]];
    const { width, height } = this.doc, step = event.shiftKey ? 10 : 1, { pixel, turns } = this.state;
    const along = Array.from({ length: turns }).reduce(([right, down]) => [-down, right], move);
    const [x, y] = pixel ? [0, 1].map(i => pixel[i] + step * along[i]) : this.place([this.size.width / 2, this.size.height / 2]).map(Math.floor);
    this.inspect(clamp(x, 0, width - 1), clamp(y, 0, height - 1));
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
