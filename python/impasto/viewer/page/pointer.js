// Pointer, wheel and keys: what dragging does.

import { clamp } from "./numbers.js";
import { ARROWS, taken } from "./elements.js";

export const TOOLS = [["light", "Light", "L", "Drag to move the light"], ["move", "Move", "M", "Drag to move the painting"],
  ["inspect", "Inspect", "I", "Choose a place to see its values"], ["note", "Note", "N", "Draw a rectangle to measure it and to write a note"]];

export class Pointer {
  constructor(app) {
    this.app = app;
    this.tool = "light";
    this.places = new Map(); // of the pointers that are down, on the canvas
    this.drawn = null; // the rectangle of a note that is being drawn
  }

  listen() {
    const { app } = this, { canvas, divider } = app;
    canvas.addEventListener("pointerdown", event => this.down(event));
    canvas.addEventListener("pointermove", event => this.move(event));
    for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, event => this.up(event));
    canvas.addEventListener("contextmenu", event => event.preventDefault());
    canvas.addEventListener("wheel", event => {
      event.preventDefault();
      const lines = event.deltaMode === 1 ? 16 : 1;
      app.zoomTo(app.view[2] * 2 ** (-event.deltaY * lines / (event.ctrlKey ? 80 : 320)), app.at(event));
    }, { passive: false });
    divider.addEventListener("pointerdown", event => divider.setPointerCapture(event.pointerId));
    divider.addEventListener("pointermove", event => divider.hasPointerCapture(event.pointerId) && app.set({ split: clamp(app.at(event)[0] / app.size.width, 0, 1) }));
    divider.addEventListener("keydown", event => {
      const [step] = ARROWS[event.key] ?? [];
      if (!step) return;
      taken(event);
      app.set({ split: clamp(app.state.split + 0.02 * step, 0, 1) });
    });
    (app.host.keys ?? app.element).addEventListener("keydown", event => this.key(event));
  }

  // An environment turns by half of a circle over the width of the canvas.
  turn(before, now) {
    this.app.rotate(180 * (now[0] - before[0]) / this.app.size.width);
  }

  // The light by where the pointer is on the canvas: its middle is in front, the nearer edge grazes.
  light([x, y]) {
    const { width, height } = this.app.size, reach = 0.48 * Math.min(width, height);
    this.app.lightAt((x - width / 2) / reach, (height / 2 - y) / reach);
  }

  inspect(at) {
    const { app } = this, [x, y] = app.place(at).map(Math.floor);
    if (x >= 0 && y >= 0 && x < app.doc.width && y < app.doc.height) app.inspect(x, y);
  }

  down(event) {
    const { app } = this, at = app.at(event);
    app.canvas.focus({ preventScroll: true });
    app.canvas.setPointerCapture(event.pointerId);
    this.places.set(event.pointerId, at);
    if (this.places.size > 1) {
      // What the first finger began was none of it.
      if (this.action !== "pinch") app.set(this.before);
      this.action = "pinch";
      this.drawn = null;
      return;
    }
    this.before = { ...app.state };
    const pan = event.button === 1 || event.button === 2 || event.shiftKey;
    this.action = pan ? "move" : this.tool;
    this.from = at;
    if (this.action === "light" && app.state.environment === "none") this.light(at);
    if (this.action === "inspect") this.inspect(at);
  }

  move(event) {
    if (!this.places.has(event.pointerId)) return;
    const { app } = this, before = this.places.get(event.pointerId), now = app.at(event);
    if (this.action === "pinch" && this.places.size === 2) {
      const other = [...this.places].find(([id]) => id !== event.pointerId)[1];
      const far = point => Math.hypot(point[0] - other[0], point[1] - other[1]);
      const middle = [(now[0] + other[0]) / 2, (now[1] + other[1]) / 2], was = [(before[0] + other[0]) / 2, (before[1] + other[1]) / 2];
      this.pan(was, middle);
      app.zoomTo(app.view[2] * far(now) / Math.max(far(before), 1), middle);
    }
    if (this.action === "move") this.pan(before, now);
    if (this.action === "light" && app.state.environment !== "none") this.turn(before, now);
    else if (this.action === "light") this.light(now);
    if (this.action === "inspect") this.inspect(now);
    if (this.action === "note") {
      const [a, b] = [app.place(this.from), app.place(now)];
      this.drawn = app.inside([Math.min(a[0], b[0]), Math.min(a[1], b[1]), Math.abs(a[0] - b[0]), Math.abs(a[1] - b[1])]);
      app.measure(this.drawn);
      app.redraw();
    }
    this.places.set(event.pointerId, now);
  }

  up(event) {
    this.places.delete(event.pointerId);
    if (this.action === "light") this.app.rest();
    if (this.action === "note" && this.drawn) this.app.askNote(this.drawn);
    if (!this.places.size) this.action = null;
  }

  pan(before, now) {
    const { app } = this, [a, b] = [app.place(before), app.place(now)], [x, y, zoom] = app.view;
    app.set({ view: [x + a[0] - b[0], y + a[1] - b[1], zoom] });
  }

  // Without a pointer: a note on the middle of what is seen, half as wide and as high.
  noteHere() {
    const { app } = this, [x, y] = app.view, [wide, high] = ["width", "height"].map(side => app.size[side] / 2 / app.view[2]);
    this.drawn = app.inside([x - wide / 2, y - high / 2, wide, high]);
    app.redraw();
    app.askNote(this.drawn);
  }

  key(event) {
    const { app } = this, { state } = app, [target] = event.composedPath();
    if (event.ctrlKey || event.metaKey || event.altKey || /^(input|textarea|select)$/i.test(target.tagName)) return;
    const own = [app.canvas, document.body].includes(target);
    if (own && (this.tool === "inspect" ? app.inspectKey(event) : app.lightKey(event))) return;
    const acts = {
      ...(own && this.tool === "note" ? { enter: () => this.noteHere() } : {}),
      "+": () => app.zoomTo(1.25 * app.view[2]), "=": () => app.zoomTo(1.25 * app.view[2]), "-": () => app.zoomTo(app.view[2] / 1.25),
      0: () => app.fit(), 1: () => app.zoomTo(1), h: () => app.togglePanel(), t: () => app.turn90(), p: () => app.copyLink(), s: () => app.savePicture(),
      r: () => app.lamp(state.elevation <= 12 ? app.onPage(state.azimuth) + 45 : 180, 10),
      ...Object.fromEntries(TOOLS.map(([name, , key]) => [key.toLowerCase(), () => app.choose(name)])),
    };
    const act = acts[event.key.toLowerCase()];
    if (!act) return;
    taken(event);
    act();
  }
}
