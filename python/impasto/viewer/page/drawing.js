// What is drawn when: the tiles that are seen, coarsely while something moves or as long as the rest takes, and what lies
// over the painting.

import { Geometry } from "./geometry.js";
import { placeOf } from "./annotations.js";
import { svg } from "./plots.js";
import { layersOf } from "./state.js";
import { POLL } from "./pacer.js";

const SHARES = [1, 0.71, 0.5, 0.35]; // of the pixels along a side, while something moves
const ROUGH = 0.35; // of them, until what takes longer than a frame is lit
const SLOW = 60, QUICK = 32; // ms that a frame takes from which on there are fewer, up to which there are more
const CALM = 40; // ms without a change until what moved is drawn with all
const HIDDEN = 250; // ms until it is tried again to draw what has no size

// Needs `renderer`, `tiles`, `host`, `pointer`, `panel` and `notes` of the viewer that it is part of, besides what `Geometry` does.
export class Drawing extends Geometry {
  size = { width: 1, height: 1 };
  moves = false; // something is moved by hand
  coarse = 0; // which of the shares it has then
  quick = 0; // how many quick frames there were without one that was not
  trust = 20; // how many of them there must be

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
    const held = this.held && !this.stale;
    this.held = false;
    if (this.stale) for (const one of [this.renderer, other]) one?.setState(this.state);
    this.stale = false;
    const last = this.doc.scales.length - 1, whole = name => this.renderer.has(name), fine = this.seen(this.wanted()).filter(whole);
    // What takes longer than a frame is shown coarsely at first, also while there are no tables of the room yet.
    const early = this.renderer.prefilter?.next() === "moving", slow = paced && !this.renderer.quick(fine), rough = !this.moves && (slow || (paced && early));
    const share = this.moves ? SHARES[this.coarse] : rough ? ROUGH : 1;
    const coarse = this.wanted(share);
    let number = coarse;
    // Coarser tiles that are not there yet are no reason to show less than is there, unless that takes long.
    if (rough || slow) while (number < last && !this.seen(number).every(whole)) number++;
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
    // What moved is seen as it was then until all of it is lit.
    if (!(held && slow)) this.show(names, share, other);
    if (other) {
      this.otherTiles.want([...here, ...names].filter(name => !other.has(name)));
      for (const gone of other.trim(new Set([...names, ...here]))) this.otherTiles.forget(gone);
    }
    for (const gone of this.renderer.trim(new Set([...names, ...here]))) this.tiles.forget(gone);
    if (names.length) this.wait.hidden = !this.unknown || this.state.layer === "status";
    const { environment } = this.state, loading = environment !== "none" && !this.renderer.environments.has(environment);
    const refining = rough || Boolean(this.renderer.prefilter?.busy);
    this.fine = rough && !early ? fine : [];
    if (refining) this.refine();
    if (names.length) this.host.shown(!refining && !loading && there.length === here.length && (!other || here.every(name => other.has(name))));
    this.drawOver();
  }

  // Tiles on the canvas, which has a share of the pixels.
  show(names, share, other) {
    this.fitCanvas(share);
    const [[a, b, c], [d, e, f]] = this.projection, { width, height } = this.size;
    const clip = [2 * a / width, -2 * d / height, 0, 2 * b / width, -2 * e / height, 0, 2 * c / width - 1, 1 - 2 * f / height, 1];
    this.renderer.draw(names, { clip, zoom: this.view[2] * share, state: this.state, relief: this.displacement, other });
  }

  // Between frames, part by part: the tiles of a picture that is shown coarsely, then the tables of a room.
  refine() {
    this.refining ||= setTimeout(() => {
      this.refining = 0;
      const { renderer } = this, { prefilter } = renderer;
      if (renderer.gl.isContextLost()) return;
      const dark = renderer.dark(this.fine);
      renderer.lightSome(dark);
      if (!dark.length && prefilter) {
        prefilter.moving = this.moves;
        this.stale = prefilter.step() || this.stale;
      }
      const left = renderer.dark(this.fine).length;
      if (!this.stale && (left || (!dark.length && prefilter?.busy))) this.refine();
      else this.redraw();
    }, POLL);
  }

  // Fewer pixels where a frame takes long. More again after some quick ones, and more of these each time it was too early.
  adapt(took) {
    this.quick = took < QUICK ? this.quick + 1 : 0;
    if (took > SLOW && this.coarse < SHARES.length - 1) {
      this.coarse++;
      if (this.tried) this.trust *= 2;
    } else if (this.coarse && this.quick > this.trust) [this.quick, this.coarse, this.tried] = [0, this.coarse - 1, true];
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
    // What is seen is what rests, unless another frame is due.
    [this.held, this.moves] = [this.moves && !this.frame, false];
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
}
