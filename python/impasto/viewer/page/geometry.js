// Where the painting lies on the canvas: zoom, quarter turns, an eye at the side, and its relief.

import { clamp } from "./numbers.js";
import { directionOf } from "./state.js";

// Needs `canvas`, `doc`, `state` and `set` of the viewer that it is part of, and its `size` on the screen: places of the
// canvas are pixels of that, however many the canvas has while something moves.
export class Geometry {
  // Pixels of the canvas for one of the page.
  get ratio() {
    return this.size.width / this.canvas.clientWidth || 1;
  }

  // Columns and rows of the canvas per pixel of the painting, and where the painting's middle of view lies.
  get view() {
    if (this.state.view) return this.state.view;
    const { size: { width, height }, ratio } = this;
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
    const after = clamp(zoom, 0.2 * Math.min(this.size.width / this.doc.width, this.size.height / this.doc.height, 1), 64);
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
    const [x, y, zoom] = this.view, { width, height } = this.size;
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
      shift: [right / this.size.width, -down / this.size.height],
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
    const zoom = Math.min(0.5 * this.size.width / width, 0.5 * this.size.height / height, 8);
    this.set({ view: [x + width / 2, y + height / 2, zoom] });
  }

  // Where on the canvas a pointer is.
  at(event) {
    const box = this.canvas.getBoundingClientRect(), ratio = this.size.width / box.width;
    return [(event.clientX - box.left) * ratio, (event.clientY - box.top) * ratio];
  }

  // The part of a rectangle that lies on the painting.
  inside([x, y, width, height]) {
    const left = clamp(x, 0, this.doc.width - 1), top = clamp(y, 0, this.doc.height - 1);
    return [left, top, Math.max(1, Math.min(width, this.doc.width - left)), Math.max(1, Math.min(height, this.doc.height - top))];
  }
}
