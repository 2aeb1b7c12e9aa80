// WebGL 2: tiles as textures, each lit once per change of the light, then shown at any zoom.

import { channelColours, displayColours } from "./colour.js";
import { groupsOf } from "./half.js";
import { planeWeights } from "./basis.js";
import { fresnel } from "./values.js";
import { QUALITY, directionOf } from "./state.js";
import { COATED, FRESNEL, lighting, showFragment, showVertex } from "./shader.js";
import { Pacer } from "./pacer.js";
import { Prefilter } from "./prefilter.js";

const MEMORY = 384 << 20; // bytes of textures that are kept
const SHARP = 4; // pixels of the canvas that one of a map is wide, from which on it keeps its edges
const TEXELS = [1 << 18, 1 << 15]; // the first number and the least of texels that are lit between two frames
const CELLS = 128; // of the grid of a tile whose heights are shown
export const MOST_DIFFERENCE = 20; // CIEDE2000 at the end of the ramp

export class Renderer {
  constructor(canvas, doc) {
    this.doc = doc;
    this.canvas = canvas;
    const gl = canvas.getContext("webgl2", { alpha: true, antialias: false, depth: this.doc.relief, stencil: false });
    if (!gl) throw new Error("This browser has no WebGL 2, which shows the painting. A current Firefox, Chrome, Edge or Safari has.");
    this.gl = gl;
    this.textures = new Map(); // name: { groups, picture, frame, key, bytes, width, height }
    this.version = 0;
    this.heights = doc.groups.findIndex(group => group.planes.includes("height"));
    this.ranges = { ...Object.fromEntries(doc.quality.map(name => [name, QUALITY[name].ends])), width: [-12, 0], strength: [-12, 0], height: [0, 1] };
    this.environments = new Map(); // name: EnvironmentMap
    this.restart();
  }

  // Everything anew, also after the browser has taken the context away.
  restart() {
    const gl = this.gl;
    this.textures.clear();
    this.programs = new Map();
    this.light = null;
    this.prefilter = null;
    this.pacer = new Pacer(gl, ...TEXELS);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    this.ramp = this.row(this.doc.ramp);
    const statuses = Array.from({ length: 256 }, (_, code) => this.doc.statuses[code]?.colour ?? [255, 0, 255]);
    this.statuses = this.row(statuses);
    this.blank = this.row([[0, 0, 0]]);
    this.weights = this.doc.basis ? this.texture(gl.TEXTURE_2D, gl.NEAREST) : null;
    this.photographs = new Map();
    this.vertices = gl.createVertexArray();
    gl.bindVertexArray(this.vertices);
  }

  // A program for what is asked of it, made once.
  programFor(key, make) {
    if (!this.programs.has(key)) this.programs.set(key, this.program(...make()));
    return this.programs.get(key);
  }

  program(vertex, fragment) {
    const gl = this.gl, program = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
      program[kind] = shader;
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost()) {
      const why = [gl.VERTEX_SHADER, gl.FRAGMENT_SHADER].map(kind => gl.getShaderInfoLog(program[kind])).join("\n");
      throw new Error(`the shader is refused: ${why} ${gl.getProgramInfoLog(program)}`);
    }
    const places = new Map();
    return { program, at: name => {
      if (!places.has(name)) places.set(name, gl.getUniformLocation(program, name));
      return places.get(name);
    } };
  }

  texture(target, filter) {
    const gl = this.gl, made = gl.createTexture();
    gl.bindTexture(target, made);
    for (const [name, value] of [["MIN_FILTER", filter], ["MAG_FILTER", filter], ["WRAP_S", gl.CLAMP_TO_EDGE], ["WRAP_T", gl.CLAMP_TO_EDGE]]) {
      gl.texParameteri(target, gl[`TEXTURE_${name}`], value);
    }
    return made;
  }

  row(colours) {
    const gl = this.gl, made = this.texture(gl.TEXTURE_2D, gl.NEAREST);
    const bytes = new Uint8Array(colours.flatMap(colour => [...colour, 255]));
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, colours.length, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, bytes);
    return made;
  }

  has(name) {
    return this.textures.has(name);
  }

  upload(name, buffer, width, height) {
    const gl = this.gl, texels = width * height;
    const kinds = {
      int16: [gl.RGBA16I, gl.RGBA_INTEGER, gl.SHORT],
      half: [gl.RGBA16F, gl.RGBA, gl.HALF_FLOAT],
      single: [gl.RGBA32F, gl.RGBA, gl.FLOAT],
    };
    const views = groupsOf(this.doc.groups, buffer, texels);
    const groups = this.doc.groups.map((group, i) => {
      const made = this.texture(gl.TEXTURE_2D_ARRAY, gl.NEAREST);
      const [inside, format, type] = kinds[group.number];
      gl.texImage3D(gl.TEXTURE_2D_ARRAY, 0, inside, width, height, group.layers, 0, format, type, views[i]);
      return made;
    });
    const picture = this.texture(gl.TEXTURE_2D, gl.LINEAR);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, width, height, 0, gl.RGBA, gl.UNSIGNED_BYTE, null);
    const frame = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, picture, 0);
    this.textures.set(name, { groups, picture, frame, width, height, bytes: buffer.byteLength + 4 * texels, key: -1 });
  }

  // Make room: tiles that were shown longest ago go first. Returns their names.
  trim(needed) {
    const gone = [];
    let total = 0;
    for (const tile of this.textures.values()) total += tile.bytes;
    for (const [name, tile] of this.textures) {
      if (total <= MEMORY) break;
      if (needed.has(name)) continue;
      for (const texture of [...tile.groups, tile.picture]) this.gl.deleteTexture(texture);
      this.gl.deleteFramebuffer(tile.frame);
      this.textures.delete(name);
      total -= tile.bytes;
      gone.push(name);
    }
    return gone;
  }

  photograph(number, image) {
    const gl = this.gl, made = this.texture(gl.TEXTURE_2D, gl.LINEAR);
    gl.pixelStorei(gl.UNPACK_COLORSPACE_CONVERSION_WEBGL, gl.NONE);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, gl.RGBA, gl.UNSIGNED_BYTE, image);
    this.photographs.set(number, made);
  }

  // The lamp and the eye of a state: directions, or places in mm.
  geometry(state) {
    const doc = this.doc, { eye } = doc;
    let view = eye.position ? [...eye.position, 1] : [...eye.direction, 0];
    if (state.tilt) view = [...directionOf(state.towards, 90 - state.tilt), 0];
    const towards = directionOf(state.azimuth, state.elevation);
    const photograph = doc.photographs[state.photograph];
    if (photograph) {
      const { direction, position, falloff, intensity } = photograph;
      const far = position ? Math.hypot(...position) : 0;
      return { view, towards: direction, light: position ? [...position, 1] : [...direction, 0], falloff: falloff ? far : 0, intensity };
    }
    if (state.near === null) return { view, towards, light: [...towards, 0], falloff: 0, intensity: 1 };
    return { view, towards, light: [...towards.map(value => value * state.near), 1], falloff: state.near, intensity: 1 };
  }

  // The environment that lights a state, if it has been loaded.
  environmentOf(state) {
    return state.layer === "picture" && state.photograph < 0 ? this.environments.get(state.environment) ?? null : null;
  }

  // From now on tiles are lit as a state says. `quality`: of the tables of an environment, made now; null: those that are
  // there, which `prefilter` refines. `linear`: see the shader.
  setState(state, quality = null, linear = false) {
    const gl = this.gl, doc = this.doc;
    const coat = doc.colours.varnishes.find(one => one.name === state.varnish) ?? null;
    const { view, towards, light, falloff, intensity } = this.geometry(state);
    const far = Math.hypot(...view.slice(0, 3));
    const colours = displayColours(doc.colours, {
      illuminant: state.illuminant, adaptation: state.adaptation, varnish: coat, exposure: state.exposure,
      cosines: [towards[2], view[2] / far], intensity: state.photograph >= 0 ? 1 : intensity,
    });
    this.colours = colours;
    const wished = this.environmentOf(state), index = coat ? coat.index : doc.index, coatScale = 2 / (1 - ((index - 1) / (index + 1)) ** 2);
    const eye = view.slice(0, 3).map(value => value / far);
    if (wished) {
      this.prefilter ??= new Prefilter(this, { fresnel: FRESNEL, coated: doc.coated ? COATED : "" });
      this.prefilter.aim(wished, { degrees: state.rotation, view: eye, index, coatScale }, quality);
    } else this.prefilter?.halt();
    // Until there are tables, the lamp; until those of this state are there, what they show.
    const { environment, degrees } = (wished && this.prefilter.shown?.goal) ?? {};
    const wanted = { layer: state.layer, ...(state.layer === "picture" ? { coat: Boolean(coat), near: light[3] > 0 && !environment, nearView: view[3] > 0, environment: Boolean(environment), linear, clipped: state.clipped } : {}) };
    this.light = this.programFor(JSON.stringify(wanted), () => lighting(doc, wanted));
    const { program, at } = this.light;
    gl.useProgram(program);
    doc.groups.forEach((_, unit) => gl.uniform1i(at(`uGroup${unit}`), unit));
    gl.uniform1i(at("uRamp"), 6);
    gl.uniform1i(at("uStatuses"), 7);
    gl.uniform3fv(at("uLight"), light.slice(0, 3));
    gl.uniform1f(at("uFalloff"), falloff);
    gl.uniform3fv(at("uView"), view.slice(0, 3).map(value => (view[3] ? value : value / far)));
    let gloss = intensity;
    if (!light[3] && !view[3]) {
      const sum = light.slice(0, 3).map((value, i) => value + view[i] / far), extent = Math.hypot(...sum);
      // Lamp and eye face each other: there is no half vector, and nothing is mirrored.
      const opposed = extent < 1e-3, v_h = opposed ? 1 : Math.min(extent / 2, 1);
      gl.uniform3fv(at("uHalf"), opposed ? [0, 0, 1] : sum.map(value => value / extent));
      gl.uniform1f(at("uTwiceOverVH"), 2 / v_h);
      if (doc.model !== "lafortune") gloss *= opposed ? 0 : fresnel(v_h, index);
    }
    if (doc.basis) this.weigh(this.light.at, towards, colours.factor);
    const columns = matrix => matrix[0].flatMap((_, k) => matrix.map(row => row[k]));
    gl.uniform3fv(at("uDiffuse"), columns(colours.diffuse));
    gl.uniform3fv(at("uInterface"), colours.interface);
    const flat = displayColours(doc.colours, { illuminant: doc.colours.illuminants[0].name, adaptation: null, varnish: null, exposure: 0, intensity: 1 });
    gl.uniform3fv(at("uFlat"), columns(flat.diffuse));
    gl.uniform1f(at("uIndex"), index);
    gl.uniform1f(at("uCoatScale"), coatScale);
    const amounts = environment ? [1, 1, 0] : [intensity, gloss, intensity];
    gl.uniform3fv(at("uAmounts"), ["matte", "gloss", "ambient"].map((name, i) => (state[name] ? amounts[i] : 0)));
    gl.uniform4fv(at("uCoat"), this.coat(coat));
    gl.uniform2fv(at("uBeneath"), this.beneath(coat));
    gl.uniform2fv(at("uRange"), this.ranges[state.layer] ?? [0, 1]);
    if (environment) {
      this.prefilter.bind(at);
      const lit = channelColours(doc.colours, { illuminant: state.illuminant, adaptation: state.adaptation, varnish: coat, exposure: state.exposure, height: eye[2], board: environment.board(degrees) });
      this.colours.factor = lit.factor;
      gl.uniform3fv(at("uChannels"), lit.diffuse.flatMap(columns));
      gl.uniform3fv(at("uFaces"), lit.interface.flat());
    }
    this.version++;
  }

  // Of a relightable image: the weights of its planes. A near lamp is taken for one in the same direction.
  weigh(at, direction, factor) {
    const gl = this.gl, weights = planeWeights(this.doc.basis, direction);
    gl.uniform1i(at("uWeights"), 5);
    gl.uniform1f(at("uFactor"), factor);
    this.bind(5, this.weights);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32F, weights.length / 4, 1, 0, gl.RGBA, gl.FLOAT, weights);
  }

  // The lobe of a coat: strength and shape.
  coat(coat) {
    if (!coat || !coat.beta) return [0, 0, 0, 0];
    if (this.doc.model === "lafortune") return [coat.beta * coat.head_on, -1, 1, coat.exponent];
    return [coat.beta, coat.gamma, 0, 0];
  }

  // What a coat leaves of the painting's own lobes.
  beneath(coat) {
    if (!coat) return [1, 0];
    const headOn = index => ((index - 1) / (index + 1)) ** 2;
    const own = headOn(this.doc.index), between = headOn(coat.index / this.doc.index);
    const mirror = this.doc.model === "lafortune";
    const bare = mirror ? own : coat.head_on;
    const share = bare > 0 ? between / bare : 1;
    return [share, mirror ? 0 : own / coat.head_on - share];
  }

  // Tiles that are not lit by the present state.
  dark(names) {
    return names.filter(name => this.textures.get(name)?.key !== this.version);
  }

  // Whether tiles can be lit between two frames.
  quick(names) {
    const dark = this.dark(names).map(name => this.textures.get(name));
    return !dark.length || (this.pacer.free && dark.reduce((sum, { width, height }) => sum + width * height, 0) <= this.pacer.most);
  }

  // Light as many of them as there is room for between two frames, at least one.
  lightSome(names) {
    const dark = [...names];
    while (dark.length && this.pacer.free) {
      const { amount } = this.pacer;
      for (let left = amount; dark.length;) {
        const { width, height } = this.textures.get(dark[0]);
        if (left < amount && left < width * height) break;
        left -= width * height;
        this.lit(dark.shift());
      }
      this.pacer.given(dark.length > 0);
    }
  }

  // Light a tile if it is not lit by the present state.
  lit(name) {
    const tile = this.textures.get(name);
    if (tile.key === this.version) return tile;
    const gl = this.gl, doc = this.doc, { program, at } = this.light;
    const [number, row, column] = name.split(/[/-]/).map(Number);
    const { factor } = doc.scales[number];
    const pitch = doc.pitch ?? 1;
    gl.useProgram(program);
    gl.uniform2f(at("uFirst"),
      ((column * doc.side + 0.5) * factor - doc.width / 2 + doc.origin[0]) * pitch,
      (doc.height / 2 - (row * doc.side + 0.5) * factor + doc.origin[1]) * pitch);
    gl.uniform1f(at("uStep"), factor * pitch);
    tile.groups.forEach((group, unit) => this.bind(unit, group, gl.TEXTURE_2D_ARRAY));
    if (doc.basis) this.bind(5, this.weights);
    this.bind(6, this.ramp);
    this.bind(7, this.statuses);
    gl.bindFramebuffer(gl.FRAMEBUFFER, tile.frame);
    gl.viewport(0, 0, tile.width, tile.height);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    tile.key = this.version;
    // The order of the map is that of use.
    this.textures.delete(name);
    this.textures.set(name, tile);
    return tile;
  }

  bind(unit, texture, target = this.gl.TEXTURE_2D) {
    this.gl.activeTexture(this.gl.TEXTURE0 + unit);
    this.gl.bindTexture(target, texture);
  }

  // Display codes of a lit tile, row by row from the top.
  codes(name) {
    const gl = this.gl, tile = this.lit(name);
    const found = new Uint8Array(4 * tile.width * tile.height);
    gl.bindFramebuffer(gl.FRAMEBUFFER, tile.frame);
    gl.readPixels(0, 0, tile.width, tile.height, gl.RGBA, gl.UNSIGNED_BYTE, found);
    return found;
  }

  // Linear light of a tile in the present state, `(y, x, 4)`, row by row from the top.
  linear(name) {
    const gl = this.gl, tile = this.textures.get(name), { frame } = tile;
    if (!gl.getExtension("EXT_color_buffer_float")) throw new Error("This browser cannot make pictures in linear light.");
    const picture = this.texture(gl.TEXTURE_2D, gl.NEAREST);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32F, tile.width, tile.height, 0, gl.RGBA, gl.FLOAT, null);
    tile.frame = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, tile.frame);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, picture, 0);
    this.lit(name);
    const found = new Float32Array(4 * tile.width * tile.height);
    gl.readPixels(0, 0, tile.width, tile.height, gl.RGBA, gl.FLOAT, found);
    gl.deleteFramebuffer(tile.frame);
    gl.deleteTexture(picture);
    [tile.frame, tile.key] = [frame, -1];
    return found;
  }

  // Show tiles on the canvas, in order. `clip`: from pixels of the painting to the canvas, columns of a matrix.
  // `relief`: where heights displace what is seen. `other`: the renderer of another painting that is compared.
  draw(names, { clip, zoom, state, relief, other }) {
    const gl = this.gl, doc = this.doc;
    const photograph = state.layer === "picture" ? this.photographs.get(state.photograph) : undefined;
    const compare = photograph || other ? state.layer === "picture" ? state.compare : "photograph" : "";
    const { program, at } = this.programFor(`show ${Boolean(relief)} ${compare} ${Boolean(other)}`, () => [showVertex(doc, Boolean(relief)), showFragment(compare, Boolean(other), Boolean(relief))]);
    const lit = names.map(name => [name, this.lit(name)]);
    // Until a tile of the other painting is there, the painting's own stands for it.
    const beside = new Map(other ? names.filter(name => other.has(name)).map(name => [name, other.lit(name).picture]) : []);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.viewport(0, 0, this.canvas.width, this.canvas.height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.useProgram(program);
    if (relief) {
      gl.enable(gl.DEPTH_TEST);
      gl.uniform1i(at("uHeights"), 3);
      gl.uniform1i(at("uCells"), CELLS);
      gl.uniform2fv(at("uShift"), relief.shift);
      gl.uniform3fv(at("uDepth"), relief.depth);
    }
    gl.uniformMatrix3fv(at("uClip"), false, clip);
    gl.uniform2f(at("uSize"), doc.width, doc.height);
    gl.uniform1i(at("uPicture"), 0);
    gl.uniform1i(at("uPhotograph"), 1);
    gl.uniform1i(at("uRamp"), 2);
    gl.uniform1f(at("uMost"), MOST_DIFFERENCE);
    gl.uniform1f(at("uSplit"), state.split * this.canvas.width);
    this.bind(1, photograph ?? this.blank);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, zoom > SHARP ? gl.NEAREST : gl.LINEAR);
    this.bind(2, this.ramp);
    for (const [name, tile] of lit) {
      const [number, row, column] = name.split(/[/-]/).map(Number);
      const size = doc.scales[number].factor;
      this.bind(0, tile.picture);
      // Single pixels keep their edges once they are large.
      const filter = size * zoom > SHARP ? gl.NEAREST : gl.LINEAR;
      gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, filter);
      if (other) {
        this.bind(1, beside.get(name) ?? tile.picture);
        gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, filter);
      }
      gl.uniform4f(at("uTile"), column * doc.side * size, row * doc.side * size, tile.width * size, tile.height * size);
      if (relief) {
        this.bind(3, tile.groups[this.heights], gl.TEXTURE_2D_ARRAY);
        gl.uniform2i(at("uTexels"), tile.width, tile.height);
        gl.drawArrays(gl.TRIANGLES, 0, 6 * CELLS * CELLS);
      } else gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
    }
    gl.disable(gl.DEPTH_TEST);
  }
}
