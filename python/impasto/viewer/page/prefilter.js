// Light of an environment as tables that the shader of a tile looks up. Irradiance is a table over normals
// [ramamoorthi2001irradiance]. Lobes are prefiltered by their width [kautz2000unified]: over the normal for one view
// (Torrance-Sparrow), or over the lobe's direction (Lafortune, as vectors). A texel of a table is a sum over few
// directions that are drawn from the lobe, each of which reads the map at the scale of its share
// [krivanek2008filtered]. Texels that are bright among others would be met by chance: they are distant lamps.

import { clamp } from "./numbers.js";
import { rotationOf } from "./environment.js";
import { Pacer } from "./pacer.js";
import { EVEN, LEVELS, VECTORS, VERTEX_OF_TABLE, facets, irradiance } from "./tables.js";
// Tables that are there soon, also while a room turns; at rest; and for a picture that is saved.
const QUALITIES = { moving: { side: 64, samples: 12 }, resting: { side: 128, samples: 32 }, saved: { side: 128, samples: 256 } };
const DIRECTIONS = [1 << 17, 1 << 14]; // the first number and the least of those over which texels sum between two frames
const UNITS = { irradiance: 8, lobes: [9, 10, 11] };

// The tables on the graphics card. Those of one goal, a room turned by degrees and seen from a place, are shown until
// those of the next are whole: coarse ones first, finer ones once the goal rests.
export class Prefilter {
  constructor(renderer, { fresnel, coated }) {
    const { gl } = renderer;
    Object.assign(this, { renderer, gl, levels: LEVELS[renderer.doc.model], mirror: renderer.doc.model === "lafortune", maps: new WeakMap(), sets: {}, shown: null, goal: null, work: null, moving: false, pacer: new Pacer(gl, ...DIRECTIONS) });
    if (!gl.getExtension("EXT_color_buffer_float")) throw new Error("This browser cannot make tables of light: it shows lamps only.");
    this.irradiance = renderer.program(VERTEX_OF_TABLE, irradiance(coated));
    this.lobes = renderer.program(VERTEX_OF_TABLE, this.mirror ? VECTORS : facets(fresnel));
    this.frame = gl.createFramebuffer();
    this.texels = renderer.texture(gl.TEXTURE_2D, gl.NEAREST);
  }

  map(environment) {
    const { gl } = this;
    if (this.maps.has(environment)) return this.maps.get(environment);
    const { side } = environment.record, size = 3 * side * side, made = this.renderer.texture(gl.TEXTURE_CUBE_MAP, gl.LINEAR);
    gl.texParameteri(gl.TEXTURE_CUBE_MAP, gl.TEXTURE_MIN_FILTER, gl.LINEAR_MIPMAP_LINEAR);
    const rest = environment.texels.slice();
    for (const { at } of environment.bright) rest.fill(0, at, at + 3);
    for (let face = 0; face < 6; face++) {
      const texels = new Uint16Array(4 * side * side);
      for (let i = 0; i < side * side; i++) for (let c = 0; c < 3; c++) texels[4 * i + c] = rest[face * size + 3 * i + c];
      gl.texImage2D(gl.TEXTURE_CUBE_MAP_POSITIVE_X + face, 0, gl.RGBA16F, side, side, 0, gl.RGBA, gl.HALF_FLOAT, texels);
    }
    gl.generateMipmap(gl.TEXTURE_CUBE_MAP);
    this.maps.set(environment, made);
    return made;
  }

  // Tables that are not shown now.
  free(side) {
    const { gl } = this, sets = this.sets[side] ??= [], spare = sets.find(one => one !== this.shown?.tables);
    if (spare) return spare;
    const irradiance = this.renderer.texture(gl.TEXTURE_2D, gl.LINEAR);
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA16F, side / 2, side / 2);
    const lobes = Array.from({ length: this.renderer.doc.lobes.length || this.renderer.doc.colours.varnishes.length ? this.mirror ? 3 : 1 : 0 }, () => {
      const made = this.renderer.texture(gl.TEXTURE_2D_ARRAY, gl.LINEAR);
      gl.texStorage3D(gl.TEXTURE_2D_ARRAY, 1, gl.RGBA16F, side, side, this.levels.count);
      return made;
    });
    sets.push({ irradiance, lobes });
    return sets.at(-1);
  }

  // What is to be shown from now on: made by `step`, or now where a quality is given.
  aim(environment, { degrees, view, index, coatScale }, quality = null) {
    const key = JSON.stringify([environment.record.name, degrees, this.mirror ? 0 : view, index]);
    this.goal = { key, environment, degrees, view, index, coatScale };
    // Coarse tables are finished first, whatever the goal is now: a room that turns is seen to turn.
    if (this.work && this.work.goal.key !== key && this.work.quality === "resting") this.work = null;
    if (!quality || (this.shown?.goal.key === key && this.shown.quality === quality)) return;
    this.work = this.begin(quality);
    this.amount = Infinity;
    this.proceed();
  }

  halt() {
    this.goal = this.work = null;
  }

  get busy() {
    return Boolean(this.work || this.next());
  }

  // The quality of the tables that are wanted next.
  next() {
    if (!this.goal) return null;
    if (this.shown?.goal.key !== this.goal.key) return "moving";
    return this.shown.quality === "moving" && !this.moving ? "resting" : null;
  }

  begin(quality) {
    this.spent = 0;
    const { side, samples } = QUALITIES[quality], tables = this.free(side), { goal } = this;
    return { quality, goal, tables, parts: this.parts(goal, tables, side, samples) };
  }

  // A part of the work, once the part before is done; whether other tables are shown from now on.
  step() {
    if (!this.pacer.free) return false;
    const quality = this.next();
    if (!this.work && !quality) return false;
    this.work ??= this.begin(quality);
    this.amount = this.pacer.amount;
    const whole = this.proceed();
    this.pacer.given(!whole);
    return whole;
  }

  proceed() {
    const { work, gl } = this;
    gl.enable(gl.SCISSOR_TEST);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.frame);
    const { done } = work.parts.next();
    gl.disable(gl.SCISSOR_TEST);
    if (done) [this.shown, this.work] = [work, null];
    return done;
  }

  // Draws tables, in parts; each part sets up what it needs, as others draw between them.
  *parts(goal, tables, side, samples) {
    const { gl, levels } = this, half = side / 2, { environment, degrees } = goal;
    const all = environment.seen(degrees), bright = environment.seen(degrees, environment.bright, Math.PI / 2 / environment.record.side);
    yield* this.rows(half, half * all.length / 4, () => this.irradianceOf(goal, tables, half, all));
    if (!tables.lobes.length) return;
    for (let level = 0; level < levels.count; level++) {
      const used = side * (level < levels.quarter ? 0.25 : level < levels.half ? 0.5 : 1);
      yield* this.rows(used, used * (samples + bright.length / 4), () => this.lobesOf(goal, tables, level, used, samples, bright));
    }
  }

  // Rows of a table, as many at a time as there is work for; less than that is added to what comes next.
  *rows(side, each, prepare) {
    for (let row = 0; row < side;) {
      const left = this.amount - this.spent, count = clamp(Math.floor(left / each), 1, side - row);
      prepare();
      this.gl.viewport(0, 0, side, side);
      this.gl.scissor(0, row, side, count);
      this.gl.drawArrays(this.gl.TRIANGLES, 0, 3);
      row += count;
      this.spent += count * each;
      if (this.spent < 0.9 * this.amount) continue;
      this.spent = 0;
      yield;
    }
  }

  // Distant lamps as the texels of a texture.
  lamps(at, lamps) {
    const { gl } = this, count = Math.max(lamps.length, 1), texels = new Float32Array(8 * count);
    lamps.forEach(({ direction, light }, i) => {
      texels.set(direction, 4 * i);
      texels.set(light, 4 * (count + i));
    });
    this.renderer.bind(1, this.texels);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32F, count, 2, 0, gl.RGBA, gl.FLOAT, texels);
    gl.uniform1i(at("uTexels"), 1);
    gl.uniform1i(at("uCount"), lamps.length);
  }

  irradianceOf({ index, coatScale }, tables, side, lamps) {
    const { gl, irradiance: { program, at } } = this;
    gl.useProgram(program);
    this.lamps(at, lamps);
    gl.uniform1f(at("uSide"), side);
    gl.uniform1f(at("uSpread"), EVEN);
    gl.uniform1f(at("uIndex"), index);
    gl.uniform1f(at("uCoatScale"), coatScale);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, tables.irradiance, 0);
    for (const other of [1, 2]) gl.framebufferTextureLayer(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0 + other, null, 0, 0);
    gl.drawBuffers([gl.COLOR_ATTACHMENT0]);
  }

  lobesOf({ environment, degrees, view, index }, tables, level, side, samples, lamps) {
    const { gl, levels, lobes: { program, at } } = this, { record } = environment;
    gl.useProgram(program);
    this.renderer.bind(0, this.map(environment), gl.TEXTURE_CUBE_MAP);
    gl.uniform1i(at("uMap"), 0);
    this.lamps(at, lamps);
    // The inverse of a rotation is its transpose, and WebGL reads columns: rows as they are.
    gl.uniformMatrix3fv(at("uRoom"), false, [0, 1, 2].flatMap(i => rotationOf(record, degrees)[i]));
    gl.uniform1f(at("uScale"), record.scale / environment.front(degrees));
    gl.uniform1f(at("uTexel"), 4 * Math.PI / (6 * record.side ** 2));
    gl.uniform1i(at("uSamples"), samples);
    gl.uniform1f(at("uSpread"), levels.spread);
    gl.uniform3fv(at("uView"), view);
    gl.uniform1f(at("uIndex"), index);
    gl.uniform1f(at("uSide"), side);
    gl.uniform1f(at("uWidth"), levels.first * levels.step ** level);
    const attachments = tables.lobes.map((_, i) => gl.COLOR_ATTACHMENT0 + i);
    tables.lobes.forEach((table, i) => gl.framebufferTextureLayer(gl.FRAMEBUFFER, attachments[i], table, 0, level));
    gl.drawBuffers(attachments);
  }

  bind(at) {
    const { gl } = this;
    gl.uniform1i(at("uIrradiance"), UNITS.irradiance);
    const { tables } = this.shown;
    this.renderer.bind(UNITS.irradiance, tables.irradiance);
    tables.lobes.forEach((table, i) => {
      gl.uniform1i(at(`uLobes${i}`), UNITS.lobes[i]);
      this.renderer.bind(UNITS.lobes[i], table, gl.TEXTURE_2D_ARRAY);
    });
  }
}
