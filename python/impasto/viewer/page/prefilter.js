// Light of an environment as tables that the shader of a tile looks up. Irradiance is a table over normals
// [ramamoorthi2001irradiance]. Lobes are prefiltered by their width [kautz2000unified]: over the normal for one view
// (Torrance-Sparrow), or over the lobe's direction (Lafortune, as vectors). A texel of a table is a sum over few
// directions that are drawn from the lobe, each of which reads the map at the scale of its share
// [krivanek2008filtered]. Texels that are bright among others would be met by chance: they are distant lamps.

import { fromHalf } from "./half.js";

// Tables while a room turns, at rest, and for a picture that is saved: what a renderer without a graphics card can do
// in time.
const QUALITIES = { moving: { side: 64, samples: 12 }, resting: { side: 128, samples: 32 }, saved: { side: 128, samples: 256 } };
const BRIGHT = 0.001, MOST_BRIGHT = 96; // share of all light of a texel that is a lamp, and how many may be
const COARSE = 16; // texels along a face, whose light is one distant lamp each in irradiance
// Of widths, half an octave apart: the first, how many, and how a hemisphere is spread on a table; wide ones up to a
// level need a quarter or a half of its side.
const LEVELS = {
  "torrance-sparrow": { first: 1.25, step: Math.SQRT1_2, count: 14, spread: 0.25, quarter: 5, half: 9 },
  lafortune: { first: 0.5, step: Math.SQRT2, count: 24, spread: 2, quarter: 4, half: 10 },
};
const EVEN = 2; // the spread of irradiance
const UNITS = { irradiance: 8, lobes: [9, 10, 11] };
const FACES = [[[0, 0, -1], [0, -1, 0], [1, 0, 0]], [[0, 0, 1], [0, -1, 0], [-1, 0, 0]], [[1, 0, 0], [0, 0, 1], [0, 1, 0]],
  [[1, 0, 0], [0, 0, -1], [0, -1, 0]], [[1, 0, 0], [0, -1, 0], [0, 0, 1]], [[-1, 0, 0], [0, -1, 0], [0, 0, -1]]];

const VERTEX_OF_TABLE = `#version 300 es
void main() {
  gl_Position = vec4(2.0 * vec2(float((gl_VertexID << 1) & 2), float(gl_VertexID & 2)) - 1.0, 0.0, 1.0);
}`;

// A direction's place on a table, and back: its stereographic projection, denser in the middle.
export const PROJECTED = `
vec2 projected(vec3 direction, float spread) {
  vec2 s = direction.xy / max(1.0 + direction.z, 1e-3);
  return 0.5 + 0.5 * s * (1.0 + spread) / (length(s) + spread);
}`;
const HEADER = `#version 300 es
precision highp float;
uniform float uSide;
uniform float uSpread;
vec3 direction() {
  vec2 p = 2.0 * gl_FragCoord.xy / uSide - 1.0;
  float r = min(length(p), 1.0 + 0.5 * uSpread);
  vec2 s = p * (uSpread / (1.0 + uSpread - r));
  if (length(p) > r) s *= r / length(p);
  float square = dot(s, s);
  return vec3(2.0 * s, 1.0 - square) / (1.0 + square);
}`;

const irradiance = coated => `${HEADER}
uniform highp sampler2D uTexels;   // directions, and below them their light
uniform int uCount;
uniform float uIndex;
uniform float uCoatScale;
out vec4 found;
${coated}
void main() {
  vec3 n = direction(), sum = vec3(0.0);
  for (int i = 0; i < uCount; i++) {
    float cosine = max(dot(n, texelFetch(uTexels, ivec2(i, 0), 0).xyz), 0.0);
    ${coated ? "cosine *= transmission(cosine);" : ""}
    sum += cosine * texelFetch(uTexels, ivec2(i, 1), 0).rgb;
  }
  found = vec4(sum, 1.0);
}`;

const SAMPLED = `${HEADER}
precision highp samplerCube;
uniform samplerCube uMap;
uniform mat3 uRoom;      // from the painting to the room
uniform float uScale;
uniform float uTexel;    // solid angle of a texel of the map
uniform int uSamples;
uniform float uWidth;
uniform vec3 uView;
uniform highp sampler2D uTexels;   // directions of lamps, and below them their light
uniform int uCount;
const float GOLDEN = 2.399963229728653;
mat3 frame(vec3 n) {
  vec3 side = normalize(abs(n.x) > 0.7 ? vec3(n.z, 0.0, -n.x) : vec3(0.0, n.z, -n.y));
  return mat3(side, cross(n, side), n);
}
// Radiance from around u within a solid angle; none from behind the wall.
vec3 radiance(vec3 u, float extent) {
  float above = clamp(0.5 + u.z / sqrt(max(extent, uTexel)), 0.0, 1.0);
  return above * uScale * textureLod(uMap, uRoom * u, max(0.5 * log2(extent / uTexel), 0.0)).rgb;
}`;

const facets = fresnel => `${SAMPLED}
uniform float uIndex;
out vec4 found;
${fresnel}
void main() {
  vec3 n = direction(), sum = vec3(0.0);
  float n_v = dot(n, uView);
  mat3 axes = frame(n);
  // Facets lean by up to 1.55 rad, drawn as their distribution D says.
  float variance = uWidth * uWidth / 0.6931471805599453, kept = 1.0 - exp(-1.55 * 1.55 / variance);
  for (int i = 0; i < uSamples; i++) {
    float d = 1.0 - kept * (float(i) + 0.5) / float(uSamples);
    float phi = sqrt(max(-variance * log(d), 1e-12)), at = GOLDEN * float(i);
    vec3 h = axes * vec3(sin(phi) * cos(at), sin(phi) * sin(at), cos(phi));
    float v_h = dot(uView, h);
    vec3 u = 2.0 * v_h * h - uView;
    float n_l = dot(n, u);
    if (v_h <= 0.0 || n_l <= 0.0 || n_v <= 0.0) continue;
    float masked = 2.0 * dot(n, h) / v_h;
    float attenuation = min(min(1.0 / n_v, masked), masked * n_l / n_v);
    float whole = 3.141592653589793 * variance * kept * sin(phi) / phi; // D over its density
    float extent = 4.0 * v_h * whole / (d * float(uSamples));
    sum += radiance(u, extent) * (fresnel(v_h) * attenuation * 4.0 * v_h * whole);
  }
  sum /= float(uSamples);
  for (int i = 0; i < uCount; i++) {
    vec3 u = texelFetch(uTexels, ivec2(i, 0), 0).xyz, h = normalize(u + uView);
    float v_h = dot(uView, h), n_l = dot(n, u), masked = 2.0 * dot(n, h) / v_h;
    float phi = 2.0 * asin(min(0.5 * length(n - h), 1.0));
    float attenuation = min(min(1.0 / n_v, masked), masked * n_l / n_v);
    if (n_l > 0.0 && n_v > 0.0) sum += texelFetch(uTexels, ivec2(i, 1), 0).rgb * (fresnel(v_h) * attenuation * exp(-min(phi * phi / variance, 87.0)));
  }
  found = vec4(sum / uWidth, 1.0);
}`;

const VECTORS = `${SAMPLED}
layout(location = 0) out vec4 across;
layout(location = 1) out vec4 upwards;
layout(location = 2) out vec4 ahead;
void main() {
  vec3 p = direction(), x = vec3(0.0), y = vec3(0.0), z = vec3(0.0);
  mat3 axes = frame(p);
  for (int i = 0; i < uSamples; i++) {
    float share = (float(i) + 0.5) / float(uSamples);
    float cosine = pow(share, 1.0 / (uWidth + 1.0)), sine = sqrt(max(1.0 - cosine * cosine, 0.0)), at = GOLDEN * float(i);
    vec3 u = axes * vec3(sine * cos(at), sine * sin(at), cosine);
    float extent = 6.283185307179586 / ((uWidth + 1.0) * max(pow(cosine, uWidth), 1e-4) * float(uSamples));
    vec3 light = radiance(u, min(extent, 3.0));
    x += u.x * light;
    y += u.y * light;
    z += u.z * light;
  }
  float factor = 6.283185307179586 * (uWidth + 2.0) / ((uWidth + 1.0) * float(uSamples));
  x *= factor;
  y *= factor;
  z *= factor;
  for (int i = 0; i < uCount; i++) {
    vec3 u = texelFetch(uTexels, ivec2(i, 0), 0).xyz;
    float cosine = max(dot(p, u), 1e-9);
    vec3 light = texelFetch(uTexels, ivec2(i, 1), 0).rgb * ((uWidth + 2.0) * exp(max(uWidth * log(cosine), -60.0)));
    x += u.x * light;
    y += u.y * light;
    z += u.z * light;
  }
  across = vec4(x, 1.0);
  upwards = vec4(y, 1.0);
  ahead = vec4(z, 1.0);
}`;

const LAST = { facets: LEVELS["torrance-sparrow"].count - 1, vectors: LEVELS.lafortune.count - 1 };

// Which part of the side of a level's table is used, in GLSL.
const part = model => `(at < ${LEVELS[model].quarter - 0.5} ? 0.25 : at < ${LEVELS[model].half - 0.5} ? 0.5 : 1.0)`;

// GLSL that looks tables up: what a lobe of unit strength reflects of each channel.
export const LOOKUPS = {
  "torrance-sparrow": `
vec3 level(float at) {
  return texture(uLobes0, vec3(place * ${part("torrance-sparrow")}, at)).rgb;
}
vec3 reflected(float gamma, float b, float c) {
  float kept = clamp(gamma, ${(1.25 * Math.SQRT1_2 ** LAST.facets).toFixed(9)}, 1.25), narrow = min(max(gamma, 5e-4) / kept, 1.0);
  float at = clamp(2.0 * log2(1.25 / kept), 0.0, ${LAST.facets}.0), first = min(floor(at), ${LAST.facets - 1}.0), t = at - first;
  // Through four levels [keys1981cubic]; the ends are repeated.
  vec3 a = level(max(first - 1.0, 0.0)), f = level(first), g = level(first + 1.0), e = level(min(first + 2.0, ${LAST.facets}.0));
  vec3 value = f + 0.5 * t * (g - a + t * (2.0 * a - 5.0 * f + 4.0 * g - e + t * (3.0 * (f - g) + e - a)));
  return kept * narrow * narrow * max(value, 0.0);
}`,
  lafortune: `
float part(float at) {
  return ${part("lafortune")};
}
vec3 reflected(float cxy, float cz, float exponent) {
  float n_v = dot(n, view), square = cxy * cxy + (cz * cz - cxy * cxy) * n_v * n_v;
  if (n_v <= 0.0 || square < 1e-17) return vec3(0.0);
  vec3 p = normalize(cxy * view + (cz - cxy) * n_v * n);
  float at = clamp(2.0 * log2(max(exponent, 0.5) / 0.5), 0.0, ${LAST.vectors}.0), first = min(floor(at), ${LAST.vectors - 1}.0), t = at - first;
  vec2 on = projected(p, ${LEVELS.lafortune.spread.toFixed(1)});
  float here = part(first), next = part(first + 1.0);
  vec3 x = mix(texture(uLobes0, vec3(on * here, first)).rgb, texture(uLobes0, vec3(on * next, first + 1.0)).rgb, t);
  vec3 y = mix(texture(uLobes1, vec3(on * here, first)).rgb, texture(uLobes1, vec3(on * next, first + 1.0)).rgb, t);
  vec3 z = mix(texture(uLobes2, vec3(on * here, first)).rgb, texture(uLobes2, vec3(on * next, first + 1.0)).rgb, t);
  float power = exp(clamp(exponent * 0.5 * naturalLogarithm(square), -60.0, 40.0));
  return power / (exponent + 2.0) * max(n.x * x + n.y * y + n.z * z, 0.0);
}`,
};
export const SPREADS = { irradiance: EVEN, lobes: LEVELS["torrance-sparrow"].spread };

// The room turned by degrees about the painting's vertical: rows of the matrix from the room to the painting.
export function rotationOf(room, degrees) {
  const sine = Math.sin(degrees * Math.PI / 180), cosine = Math.cos(degrees * Math.PI / 180), [a, b, c] = room.rotation;
  return [a.map((value, i) => cosine * value + sine * c[i]), b, a.map((value, i) => -sine * value + cosine * c[i])];
}

// A map as the page gets it: faces of a cube, half precision, red, green and blue. The light of its coarse texels is
// kept with the direction from which it comes on average.
export class EnvironmentMap {
  constructor(record, buffer) {
    const { side } = record;
    this.record = record;
    this.texels = new Uint16Array(buffer);
    if (this.texels.length !== 18 * side * side) throw new Error(`an environment of ${buffer.byteLength} bytes, expected ${36 * side * side}`);
    const linear = Float32Array.from({ length: 65536 }, (_, bits) => fromHalf(bits)), across = Math.min(COARSE, side), size = side / across;
    this.linear = linear;
    this.lamps = [];
    const bright = [];
    let total = 0;
    FACES.forEach(([right, down, out], face) => {
      const sums = Array.from({ length: across * across }, () => new Float64Array(6));
      for (let row = 0; row < side; row++) for (let column = 0; column < side; column++) {
        const s = 2 * (column + 0.5) / side - 1, t = 2 * (row + 0.5) / side - 1, far = Math.sqrt(1 + s * s + t * t);
        const at = 3 * (face * side * side + row * side + column), solid = record.scale * 4 / (side * side * far ** 3);
        const [red, green, blue] = [0, 1, 2].map(channel => solid * linear[this.texels[at + channel]]), sum = sums[Math.min(Math.floor(row / size), across - 1) * across + Math.min(Math.floor(column / size), across - 1)];
        const power = 0.2126 * red + 0.7152 * green + 0.0722 * blue, weight = (power + 1e-12) / far;
        total += power;
        bright.push([power, at, [red, green, blue], [0, 1, 2].map(i => (s * right[i] + t * down[i] + out[i]) / far)]);
        sum[0] += red;
        sum[1] += green;
        sum[2] += blue;
        for (let i = 0; i < 3; i++) sum[3 + i] += weight * (s * right[i] + t * down[i] + out[i]);
      }
      for (const [red, green, blue, ...towards] of sums) {
        const length = Math.hypot(...towards);
        if (length > 0 && red + green + blue > 0) this.lamps.push({ light: [red, green, blue], towards: towards.map(value => value / length) });
      }
    });
    this.bright = bright.filter(([power]) => power > BRIGHT * total).sort(([one], [other]) => other - one).slice(0, MOST_BRIGHT)
      .map(([, at, light, towards]) => ({ at, light, towards }));
  }

  // Radiance from a direction of the room.
  at([x, y, z]) {
    const { side, scale } = this.record, far = [x, y, z], largest = Math.max(...far.map(Math.abs)), axis = far.findIndex(value => Math.abs(value) === largest);
    const face = 2 * axis + (far[axis] < 0 ? 1 : 0), [right, down] = FACES[face];
    const [column, row] = [right, down].map(along => Math.min(side - 1, Math.floor((along.reduce((sum, value, i) => sum + value * far[i], 0) / largest + 1) / 2 * side)));
    const at = 3 * ((face * side + row) * side + column);
    return [0, 1, 2].map(channel => scale * this.linear[this.texels[at + channel]]);
  }

  // What all light in front of the painting sums to. Exposure follows it, and tables of it as 1 are within half
  // precision, whatever is behind the wall.
  front(degrees) {
    if (this.fronts?.degrees !== degrees) this.fronts = { degrees, sum: this.cut(degrees, this.lamps, Math.PI / 2 / COARSE).reduce((sum, { light }) => sum + light[0] + light[1] + light[2], 0) };
    return Math.max(this.fronts.sum, 1e-30);
  }

  // What the turned room sends to the painting, in all as 1.
  seen(degrees, lamps = this.lamps, width = Math.PI / 2 / COARSE) {
    const front = this.front(degrees);
    return this.cut(degrees, lamps, width).map(({ direction, light }) => ({ direction, light: light.map(value => value / front) }));
  }

  // A lamp that the wall cuts off in part keeps the rest.
  cut(degrees, lamps, width) {
    const rows = rotationOf(this.record, degrees);
    return lamps.map(({ light, towards }) => {
      const direction = rows.map(row => row[0] * towards[0] + row[1] * towards[1] + row[2] * towards[2]);
      const above = Math.min(Math.max(0.5 + direction[2] / width, 0), 1);
      return { direction, light: light.map(value => above * value) };
    }).filter(one => one.light.some(value => value > 0));
  }

  // Irradiance of a board that faces the viewer.
  board(degrees) {
    return this.seen(degrees).reduce((sum, { direction, light }) => sum.map((value, i) => value + Math.max(direction[2], 0) * light[i]), [0, 0, 0]);
  }
}

// The tables on the graphics card.
export class Prefilter {
  constructor(renderer, { fresnel, coated }) {
    const { gl } = renderer;
    Object.assign(this, { renderer, gl, levels: LEVELS[renderer.doc.model], mirror: renderer.doc.model === "lafortune", maps: new WeakMap(), key: "" });
    if (!gl.getExtension("EXT_color_buffer_float")) throw new Error("This browser cannot make tables of light: it shows lamps only.");
    this.irradiance = renderer.program(VERTEX_OF_TABLE, irradiance(coated));
    this.lobes = renderer.program(VERTEX_OF_TABLE, this.mirror ? VECTORS : facets(fresnel));
    this.frame = gl.createFramebuffer();
    this.tables = {};
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

  tablesOf(side) {
    const { gl } = this;
    return this.tables[side] ??= {
      irradiance: (() => {
        const made = this.renderer.texture(gl.TEXTURE_2D, gl.LINEAR);
        gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA16F, side / 2, side / 2);
        return made;
      })(),
      lobes: Array.from({ length: this.renderer.doc.lobes.length || this.renderer.doc.colours.varnishes.length ? this.mirror ? 3 : 1 : 0 }, () => {
        const made = this.renderer.texture(gl.TEXTURE_2D_ARRAY, gl.LINEAR);
        gl.texStorage3D(gl.TEXTURE_2D_ARRAY, 1, gl.RGBA16F, side, side, this.levels.count);
        return made;
      }),
    };
  }

  // Tables for a room turned by degrees, seen from `view`, of one of the qualities.
  make(environment, { degrees, view, index, coatScale, quality }) {
    const key = JSON.stringify([environment.record.name, degrees, this.mirror ? 0 : view, index, quality]);
    if (key === this.key) return;
    this.key = key;
    const { gl, levels } = this, { side, samples } = QUALITIES[quality];
    this.now = this.tablesOf(side);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.frame);
    const { at } = this.irradiance;
    gl.useProgram(this.irradiance.program);
    this.lamps(at, environment.seen(degrees));
    gl.uniform1f(at("uSide"), side / 2);
    gl.uniform1f(at("uSpread"), EVEN);
    gl.uniform1f(at("uIndex"), index);
    gl.uniform1f(at("uCoatScale"), coatScale);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, this.now.irradiance, 0);
    for (const other of [1, 2]) gl.framebufferTextureLayer(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0 + other, null, 0, 0);
    gl.drawBuffers([gl.COLOR_ATTACHMENT0]);
    gl.viewport(0, 0, side / 2, side / 2);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    if (!this.now.lobes.length) return;
    this.lobeTables(environment, { degrees, view, index, side, samples, levels });
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

  lobeTables(environment, { degrees, view, index, side, samples, levels }) {
    const { gl } = this, { at } = this.lobes, { record } = environment;
    gl.useProgram(this.lobes.program);
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_CUBE_MAP, this.map(environment));
    gl.uniform1i(at("uMap"), 0);
    this.lamps(at, environment.seen(degrees, environment.bright, Math.PI / 2 / record.side));
    // The inverse of a rotation is its transpose, and WebGL reads columns: rows as they are.
    gl.uniformMatrix3fv(at("uRoom"), false, [0, 1, 2].flatMap(i => rotationOf(record, degrees)[i]));
    gl.uniform1f(at("uScale"), record.scale / environment.front(degrees));
    gl.uniform1f(at("uTexel"), 4 * Math.PI / (6 * record.side ** 2));
    gl.uniform1i(at("uSamples"), samples);
    gl.uniform1f(at("uSpread"), levels.spread);
    gl.uniform3fv(at("uView"), view);
    gl.uniform1f(at("uIndex"), index);
    const attachments = this.now.lobes.map((_, i) => gl.COLOR_ATTACHMENT0 + i);
    for (let level = 0; level < levels.count; level++) {
      const used = side * (level < levels.quarter ? 0.25 : level < levels.half ? 0.5 : 1);
      gl.uniform1f(at("uSide"), used);
      gl.viewport(0, 0, used, used);
      gl.uniform1f(at("uWidth"), levels.first * levels.step ** level);
      this.now.lobes.forEach((table, i) => gl.framebufferTextureLayer(gl.FRAMEBUFFER, attachments[i], table, 0, level));
      gl.drawBuffers(attachments);
      gl.drawArrays(gl.TRIANGLES, 0, 3);
    }
    gl.bindTexture(gl.TEXTURE_CUBE_MAP, null);
  }

  bind(at) {
    const { gl } = this;
    gl.uniform1i(at("uIrradiance"), UNITS.irradiance);
    this.renderer.bind(UNITS.irradiance, this.now.irradiance);
    this.now.lobes.forEach((table, i) => {
      gl.uniform1i(at(`uLobes${i}`), UNITS.lobes[i]);
      gl.activeTexture(gl.TEXTURE0 + UNITS.lobes[i]);
      gl.bindTexture(gl.TEXTURE_2D_ARRAY, table);
    });
  }
}
