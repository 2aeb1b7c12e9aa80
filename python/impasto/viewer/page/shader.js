// The shader that lights a tile: what a picture of impasto.render is, in WebGL 2. It is made for the maps that a
// painting has, for one layer and for the effects that are on: what is not shown costs nothing. A renderer without a
// graphics card runs both sides of every branch.

import { DECODED, weightedSum } from "./basis.js";
import { LOOKUPS, PROJECTED, SPREADS, TRIANGLE } from "./tables.js";
import { shapeNames } from "./values.js";

const UNKNOWN = "vec4(vec3(((at.x / 8 + at.y / 8) & 1) == 0 ? 0.227 : 0.29), 1.0)";
const VARYINGS = 15; // vectors that every device has

// Both shaders of a tile. What is the same for all pixels comes to them in flat varyings, as much as there is room for: a
// renderer without a graphics card looks a uniform up for each pixel, which takes as long as ten multiplications.
export function lighting(doc, options) {
  const declared = [], copied = [], text = fragment(doc, options);
  let left = VARYINGS;
  const pixel = text.replace(/^uniform ((?:vec\d|float) )u(\w+?)(\[\d+\])?;.*$/gm, (line, type, name, many = "") => {
    if (text.split(`u${name}`).length < 3) return "";
    const size = parseInt(many.slice(1), 10) || 1;
    if (size > left) return line;
    left -= size;
    declared.push(`uniform ${type}u${name}${many};\nflat out ${type}v${name}${many};`);
    copied.push(`v${name} = u${name};`);
    return `flat in ${type}v${name}${many};\n#define u${name} v${name}`;
  });
  return [`#version 300 es
${declared.join("\n")}
${TRIANGLE}
  ${copied.join("\n  ")}
}`, pixel];
}

// Colours of stripes where the display clips: brighter than its white, or more saturated than its primaries.
export const MARKS = { bright: "1.0, 0.0, 0.3", outside: "0.1, 0.4, 1.0" };

export const FRESNEL = `
float fresnel(float c) {
  float q = sqrt(uIndex * uIndex + c * c - 1.0);
  float sum = q + c, difference = q - c;
  float perpendicular = difference / sum;
  float parallel = (c * sum - 1.0) / (c * difference + 1.0);
  return 0.5 * perpendicular * perpendicular * (parallel * parallel + 1.0);
}`;

// `before`: what all lobes of a pixel share; `gloss` is the light that reaches them. `lobe`: one of them.
const MODELS = {
  "torrance-sparrow": {
    functions: `
// phi^2 from 1 - cos(phi): nothing is lost near 0, as the arc cosine would.
float phiSquared(float e) {
  float sum = 6.2160062160e-4;
  sum = sum * e + 1.5222872361e-3;
  sum = sum * e + 3.8480038480e-3;
  sum = sum * e + 1.0158730159e-2;
  sum = sum * e + 2.8571428571e-2;
  sum = sum * e + 8.8888888889e-2;
  sum = sum * e + 3.3333333333e-1;
  return (sum * e + 2.0) * e;
}
float facets(float lean, float gamma) {
  float width = clamp(gamma, 5e-4, 1.25);
  return exp(-min(lean / (width * width), 87.0));
}`,
    // D F G / (N.V) [torrance1967theory]; of a distant lamp and a distant eye, F is in the light.
    before: distant => `${distant ? "  vec3 halfway = uHalf;\n  float twice_over_v_h = uTwiceOverVH;" : `  vec3 sum = light + view;
  float extent = sqrt(max(dot(sum, sum), 1e-6)), v_h = min(0.5 * extent, 1.0);
  vec3 halfway = sum / extent;
  float twice_over_v_h = 2.0 / v_h;
  gloss *= extent > 1e-3 ? fresnel(v_h) : 0.0;`}
  float open = 1.0 / max(n_v, 1e-30), masked = twice_over_v_h * dot(n, halfway);
  gloss *= min(min(masked, open), masked * n_l * open);
  vec3 chord = n - halfway;
  float lean = 0.6931471805599453 * phiSquared(0.5 * dot(chord, chord));`,
    lobe: gamma => `gloss * facets(lean, ${gamma})`,
  },
  lafortune: {
    functions: `
float raised(float base, float exponent) {
  float value = exp(clamp(exponent * naturalLogarithm(clamp(base, 2e-9, 3e38)), -60.0, 40.0));
  return base > 2.061153622438558e-9 ? value : 0.0;
}`,
    // The lobe of Lafortune et al. [lafortune1997nonlinear], in the domain of logarithms.
    before: () => `  float upright = n_l * n_v, across = dot(light, view) - upright;
  gloss *= n_l;`,
    lobe: (cxy, cz, exponent) => `gloss * raised(${cxy} * across + ${cz} * upright, ${exponent})`,
  },
};

const LOGARITHM = `
// The built-in logarithm is not accurate enough near 1 on every device, and here it is multiplied by hundreds.
float naturalLogarithm(float x) {
  int bits = floatBitsToInt(x);
  int exponent = (bits - 0x3f3504f3) >> 23;
  float e = float(exponent);
  float f = intBitsToFloat(bits - (exponent << 23)) - 1.0;
  float square = f * f;
  float tail = 7.0376836292e-2;
  tail = tail * f - 1.1514610310e-1;
  tail = tail * f + 1.1676998740e-1;
  tail = tail * f - 1.2420140846e-1;
  tail = tail * f + 1.4249322787e-1;
  tail = tail * f - 1.6668057665e-1;
  tail = tail * f + 2.0000714765e-1;
  tail = tail * f - 2.4999993993e-1;
  tail = tail * f + 3.3333331174e-1;
  return e * 0.693359375 + (f + (-0.5 * square + (tail * f * square - e * 2.1219444005469058e-4)));
}`;

export const COATED = `
// Wolff's model [wolff1994diffuse]: what a smooth interface lets in and out, relative to normal incidence.
float transmission(float cosine) {
  float c = max(cosine, 1e-4);
  float q = max(sqrt(uIndex * uIndex + c * c - 1.0), c);
  float a = 1.0 / (q + c);
  float b = 1.0 / (uIndex * c + q / uIndex);
  return uCoatScale * q * c * (a * a + b * b);
}`;

// GLSL that reads a plane.
function plane(doc, name) {
  for (const [unit, group] of doc.groups.entries()) {
    const at = group.planes.indexOf(name);
    if (at >= 0) return `g${unit}_${at >> 2}.${"xyzw"[at & 3]}`;
  }
  throw new Error(`no plane ${name}`);
}

// `coat`, `near` and `nearView`: whether there is a varnish, whether lamp and eye are places. `environment`: whether
// light comes from one in place of a lamp. `linear`: light of the display as it is, instead of its codes. `clipped`: mark
// what the display cannot show.
export function fragment(doc, { layer, coat, near, nearView, environment, linear, clipped }) {
  const k = doc.coefficients, mirror = doc.model === "lafortune", picture = layer === "picture";
  const used = new Set(["flags"]), end = shownAs({ linear, clipped });
  const read = name => {
    used.add(name);
    return plane(doc, name);
  };
  const sum = (prefix, columns) => Array.from({ length: k }, (_, i) => `${read(prefix + i)} * ${columns}[${i}]`).join(" + ");
  const body = {
    picture: () => (doc.basis ? relit(doc, read, end) : (environment ? surrounded : lit)(doc, { coat, near, nearView, read, end })),
    colour: () => `shown = vec4(encoded(${sum("diffuse", "uFlat")}), 1.0);`,
    normals: () => `shown = vec4(0.5 * ${normal(doc, read)} + 0.5, 1.0);`,
    width: () => strongest(doc, "wide", mirror, read, sum),
    strength: () => strongest(doc, "strength", mirror, read, sum),
    ...Object.fromEntries(doc.quality.map(name => [name, () => {
      const value = read(name);
      return `shown = ${value} > 0.0 ? ramp(log2(${value})) : ${value} == 0.0 ? ramp(-99.0) : ${UNKNOWN};`;
    }])),
    height: () => `shown = ramp(${read("height")});`,
    status: () => "",
  }[layer]();
  const samplers = doc.groups.map((group, unit) =>
    `uniform highp ${group.number === "int16" ? "i" : ""}sampler2DArray uGroup${unit};`);
  const fetches = doc.groups.flatMap((group, unit) => Array.from({ length: group.layers }, (_, layer) =>
    (group.planes.slice(4 * layer, 4 * layer + 4).some(name => used.has(name))
      ? [`  ${group.number === "int16" ? "i" : ""}vec4 g${unit}_${layer} = texelFetch(uGroup${unit}, ivec3(at, ${layer}), 0);`] : []))).flat();
  return `#version 300 es
precision highp float;
precision highp int;
precision highp sampler2DArray;
precision highp isampler2DArray;
${samplers.join("\n")}
uniform sampler2D uRamp;
uniform sampler2D uStatuses;
${doc.basis ? "uniform highp sampler2D uWeights;\nuniform float uFactor;" : ""}
uniform vec2 uFirst;      // first pixel of the tile from the painting's middle, in mm
uniform float uStep;      // width of a pixel of this scale in mm
uniform vec3 uLight;      // direction to the lamp, or its place in mm
uniform float uFalloff;   // distance of the lamp from the middle, or 0 for no fall-off
uniform vec3 uAmounts;    // of the light for matte paint, for lobes and from all sides
uniform vec3 uView;       // direction to the eye, or its place in mm
uniform vec3 uDiffuse[${k}];
uniform vec3 uInterface;
uniform vec3 uFlat[${k}]; // the same under white light, for the layer of colours
uniform vec3 uHalf;       // of a distant lamp and a distant eye, what the lobes need of both
uniform float uTwiceOverVH;
uniform float uIndex;
uniform float uCoatScale;
uniform vec4 uCoat;       // strength and shape of the varnish's lobe
uniform vec2 uBeneath;    // what it leaves of the lobes: a share, and more of it where they are metal's
uniform vec2 uRange;
${environment ? `uniform sampler2D uIrradiance;
uniform sampler2DArray uLobes0;
uniform sampler2DArray uLobes1;
uniform sampler2DArray uLobes2;
uniform vec3 uChannels[${3 * k}]; // of the environment, each as uDiffuse and uInterface
uniform vec3 uFaces[3];` : ""}
out vec4 shown;

${environment ? "vec3 n, view;\nvec2 place;" : ""}
${picture && mirror ? LOGARITHM : ""}
${picture && !environment ? doc.basis ? DECODED : `${mirror ? "" : FRESNEL}${MODELS[doc.model].functions}` : ""}
${picture && doc.coated ? COATED : ""}
${environment ? `${PROJECTED}${LOOKUPS[doc.model]}` : ""}
// Of IEC 61966-2-1, within 0.009 of an 8-bit code: the power as a polynomial in the fourth root, with the least largest
// error above the straight part. Two square roots take a third of the time of a power.
vec3 encoded(vec3 linear) {
  vec3 value = clamp(linear, 0.0, 1.0), s = sqrt(value), r = sqrt(s);
  return mix(12.92 * value, (0.08132963 * s - 0.33550069 * r + 1.12268087) * s + 0.19613613 * r - 0.06461157, step(0.0031308, value));
}
vec4 ramp(float value) {
  return texelFetch(uRamp, ivec2(int(clamp((value - uRange.x) / (uRange.y - uRange.x), 0.0, 1.0) * 255.0 + 0.5), 0), 0);
}

void main() {
  ivec2 at = ivec2(gl_FragCoord.xy);
${fetches.join("\n")}
  int flags = ${plane(doc, "flags")};
  bool known = flags >= ${doc.shown};
${layer === "status" ? `  int status = known ? flags - ${doc.shown} : flags;
  shown = status == ${doc.unread} ? ${UNKNOWN} : texelFetch(uStatuses, ivec2(status, 0), 0);` : `  ${body}
  // No number of a pixel that is not known is used; as a branch it would take longer.
  if (!known) shown = ${picture ? "vec4(0.0)" : UNKNOWN};`}
}`;
}

// From linear light to the display.
const shownAs = ({ linear, clipped }) => (linear ? "shown = vec4(colour, 1.0);" : `shown = vec4(encoded(colour), 1.0);
${clipped ? `  if (((at.x + at.y) & 3) < 2) {
    if (max(colour.r, max(colour.g, colour.b)) > 1.0) shown.rgb = vec3(${MARKS.bright});
    else if (min(colour.r, min(colour.g, colour.b)) < -1e-3) shown.rgb = vec3(${MARKS.outside});
  }` : ""}`);

// Where a pixel lies, its normal, and what a varnish leaves of its lobes.
const PLACE = "  vec3 at_mm = vec3(uFirst + vec2(gl_FragCoord.x - 0.5, 0.5 - gl_FragCoord.y) * uStep, 0.0);";
const normal = (doc, read) => `vec3(${["x", "y", "z"].map(read).join(", ")}) / ${doc.unit}.0`;
const keeping = (doc, read) => `  float kept = uBeneath.x${doc.model !== "lafortune" && doc.beneath ? ` + uBeneath.y * ${read("beneath")}` : ""};`;

// The light of a lamp that a pixel reflects: of each coefficient, and of what is mirrored in its own colour.
function lit(doc, { coat, near, nearView, read, end }) {
  const k = Array.from({ length: doc.coefficients }, (_, i) => i), { before, lobe } = MODELS[doc.model];
  const lobes = doc.lobes.map(({ tinted }, number) => {
    const value = `${coat ? "kept * " : ""}${lobe(...shapeNames(doc).map(name => read(name + number)))}`, strength = `strength${number}_`;
    if (!tinted) return `  specular += ${value} * ${read(`${strength}0`)};`;
    return `  value = ${value};\n${k.map(i => `  c${i} += value * ${read(strength + i)};`).join("\n")}`;
  });
  if (coat) lobes.push(`  specular += uCoat.x * ${lobe("uCoat.y", "uCoat.z", "uCoat.w")};`);
  return `vec3 n = ${normal(doc, read)};
  float reach = 1.0;
${near || nearView ? PLACE : ""}
${near ? `  vec3 way = uLight - at_mm;
  float inverse = inversesqrt(dot(way, way));
  vec3 light = way * inverse;
  if (uFalloff > 0.0) reach = uFalloff * uFalloff * inverse * inverse;` : "  vec3 light = uLight;"}
  vec3 view = ${nearView ? "normalize(uView - at_mm)" : "uView"};
  float n_l = dot(n, light), n_v = dot(n, view);
  float matte = uAmounts.x * reach * max(n_l, 0.0);
${doc.coated ? "  matte = n_l > 0.0 && n_v > 0.0 ? matte * transmission(n_l) * transmission(n_v) : 0.0;" : ""}
${k.map(i => `  float c${i} = matte * ${read(`diffuse${i}`)}${doc.ambient ? ` + uAmounts.z * ${read(`ambient${i}`)}` : ""};`).join("\n")}
  float specular = 0.0, value;
${coat ? keeping(doc, read) : ""}
${lobes.length ? `  float gloss = n_l > 0.0 && n_v > 0.0 ? uAmounts.y * reach : 0.0;\n${before(!near && !nearView)}` : ""}
${lobes.join("\n")}
  vec3 colour = ${k.map(i => `c${i} * uDiffuse[${i}]`).join(" + ")}${lobes.length ? " + specular * uInterface" : ""};
  ${end}`;
}

// What a relightable image shows, whose functions know the direction of the light alone.
function relit(doc, read, end) {
  return `${weightedSum(doc.basis, read)}
  colour *= uFactor;
  ${end}`;
}

// The light of an environment that a pixel reflects: of each channel its irradiance and what the lobes mirror.
function surrounded(doc, { coat, nearView, read, end }) {
  const channels = prefix => Array.from({ length: doc.coefficients }, (_, i) =>
    `${read(prefix + i)} * (e.r * uChannels[${i}] + e.g * uChannels[${doc.coefficients + i}] + e.b * uChannels[${2 * doc.coefficients + i}])`).join(" + ");
  const kept = coat ? "kept * " : "";
  const lobes = doc.lobes.map((lobe, number) => {
    const shape = [...shapeNames(doc).map(name => read(name + number)), "0.0", "0.0"].slice(0, 3).join(", ");
    if (lobe.tinted) return `  e = ${kept}uAmounts.y * reflected(${shape});\n  colour += ${channels(`strength${number}_`)};`;
    return `  specular += ${kept}uAmounts.y * ${read(`strength${number}_0`)} * reflected(${shape});`;
  });
  return `n = ${normal(doc, read)};
${nearView ? PLACE : ""}
  view = ${nearView ? "normalize(uView - at_mm)" : "uView"};
  vec3 e = uAmounts.x * texture(uIrradiance, projected(n, ${SPREADS.irradiance.toFixed(1)})).rgb;
${doc.coated ? "  float n_v = dot(n, view);\n  e *= n_v > 0.0 ? transmission(n_v) : 0.0;" : ""}
  vec3 colour = ${channels("diffuse")}, specular = vec3(0.0);
  place = projected(n, ${SPREADS.lobes});
${coat ? keeping(doc, read) : ""}
${lobes.join("\n")}
${coat ? "  specular += uAmounts.y * uCoat.x * reflected(uCoat.y, uCoat.z, uCoat.w);" : ""}
  colour += specular.r * uFaces[0] + specular.g * uFaces[1] + specular.b * uFaces[2];
  ${end}`;
}

// Width or strength of the lobe that reflects most: strength times squared width. Of a coloured lobe the strength is
// its luminance under white light.
function strongest(doc, which, mirror, read, sum) {
  const parts = doc.lobes.map((lobe, number) => {
    const strength = lobe.tinted ? `dot(vec3(0.2126, 0.7152, 0.0722), ${sum(`strength${number}_`, "uFlat")})` : read(`strength${number}_0`);
    const wide = mirror ? `0.5 * acos(pow(0.5, 1.0 / max(${read(`exponent${number}`)}, 1e-3)))` : read(`gamma${number}`);
    return `  { float s = ${strength}, w = ${wide}; if (s * w * w > most) { most = s * w * w; strength = s; wide = w; } }`;
  });
  return `float most = 0.0, strength = 0.0, wide = 0.0;
${parts.join("\n")}
  shown = most > 0.0 ? ramp(log2(max(${which}, 1e-12))) : ${UNKNOWN};`;
}

// `displaced`: a tile is a grid whose corners stand at their heights, as an eye at the side sees them.
export function showVertex(doc, displaced) {
  const unit = doc.groups.findIndex(group => group.planes.includes("height"));
  const at = displaced ? doc.groups[unit].planes.indexOf("height") : 0;
  return `#version 300 es
precision highp float;
precision highp sampler2DArray;
uniform vec4 uTile;   // left, top, width, height on the painting, in pixels
uniform mat3 uClip;   // from the painting to the canvas
uniform vec2 uSize;   // of the painting
${displaced ? `uniform sampler2DArray uHeights;
uniform ivec2 uTexels;
uniform int uCells;   // of the grid, along a side
uniform vec2 uShift;  // on the canvas, for a mm of height
uniform vec3 uDepth;  // away from the eye, for a column, a row and a mm of height` : ""}
out vec2 vTexture;
out vec2 vPainting;
void main() {
${displaced ? `  int cell = gl_VertexID / 6, corner = gl_VertexID % 6;
  // Two triangles: corners 0 1 2 and 2 1 3.
  int which = corner < 3 ? corner : corner == 3 ? 2 : corner == 4 ? 1 : 3;
  ivec2 node = ivec2(cell % uCells, cell / uCells) + ivec2(which & 1, which >> 1);
  // A pixel beyond each edge: tiles that stand at other heights there show no gap.
  vTexture = (vec2(node) / float(uCells) - 0.5) * (1.0 + 2.0 / vec2(uTexels)) + 0.5;
  ivec2 texel = clamp(ivec2(vTexture * vec2(uTexels)), ivec2(0), uTexels - 1);
  float height = texelFetch(uHeights, ivec3(texel, ${at >> 2}), 0).${"xyzw"[at & 3]};` : `  vTexture = vec2(float(gl_VertexID & 1), float(gl_VertexID >> 1));`}
  vec2 place = uTile.xy + vTexture * uTile.zw;
  vPainting = place / uSize;
  gl_Position = vec4((uClip * vec3(place, 1.0)).xy, 0.0, 1.0);
${displaced ? `  gl_Position.xy += uShift * height;
  gl_Position.z = dot(uDepth, vec3(place, height));` : ""}
}`;
}

const DIFFERENCE = `
vec3 lab(vec3 code) {
  vec3 linear = mix(code / 12.92, pow((code + 0.055) / 1.055, vec3(2.4)), step(0.04045, code));
  vec3 xyz = mat3(0.4124, 0.2126, 0.0193, 0.3576, 0.7152, 0.1192, 0.1805, 0.0722, 0.9505) * linear / vec3(0.9505, 1.0, 1.089);
  vec3 f = mix((24389.0 / 27.0 * xyz + 16.0) / 116.0, pow(max(xyz, 1e-9), vec3(1.0 / 3.0)), step(216.0 / 24389.0, xyz));
  return vec3(116.0 * f.y - 16.0, 500.0 * (f.x - f.y), 200.0 * (f.y - f.z));
}
float hue(float b, float a) {
  return a == 0.0 && b == 0.0 ? 0.0 : mod(degrees(atan(b, a)) + 360.0, 360.0);
}
// CIEDE2000 [sharma2005ciede2000].
float difference(vec3 one, vec3 other) {
  float mean = 0.5 * (length(one.yz) + length(other.yz));
  float seventh = pow(mean, 7.0);
  float g = 0.5 * (1.0 - sqrt(seventh / (seventh + 6103515625.0)));
  vec2 a = (1.0 + g) * vec2(one.y, other.y);
  vec2 c = vec2(length(vec2(a.x, one.z)), length(vec2(a.y, other.z)));
  vec2 h = vec2(hue(one.z, a.x), hue(other.z, a.y));
  float dh = h.y - h.x, sum = h.x + h.y;
  bool grey = c.x * c.y == 0.0;
  float mh = grey ? sum : abs(dh) <= 180.0 ? 0.5 * sum : sum < 360.0 ? 0.5 * (sum + 360.0) : 0.5 * (sum - 360.0);
  dh = grey ? 0.0 : dh > 180.0 ? dh - 360.0 : dh < -180.0 ? dh + 360.0 : dh;
  float ml = 0.5 * (one.x + other.x), mc = 0.5 * (c.x + c.y);
  float t = 1.0 - 0.17 * cos(radians(mh - 30.0)) + 0.24 * cos(radians(2.0 * mh)) + 0.32 * cos(radians(3.0 * mh + 6.0))
    - 0.20 * cos(radians(4.0 * mh - 63.0));
  float l50 = (ml - 50.0) * (ml - 50.0);
  float dl = (other.x - one.x) / (1.0 + 0.015 * l50 / sqrt(20.0 + l50));
  float dc = (c.y - c.x) / (1.0 + 0.045 * mc);
  float dH = 2.0 * sqrt(c.x * c.y) * sin(radians(0.5 * dh)) / (1.0 + 0.015 * mc * t);
  float theta = 30.0 * exp(-pow((mh - 275.0) / 25.0, 2.0));
  float mc7 = pow(mc, 7.0);
  float rt = -2.0 * sqrt(mc7 / (mc7 + 6103515625.0)) * sin(radians(2.0 * theta));
  return sqrt(max(dl * dl + dc * dc + dH * dH + rt * dc * dH, 0.0));
}`;

// `compare`: nothing beside the picture, the "photograph" or their "difference". `tiled`: what is beside it lies in
// tiles as the picture does. `hidden`: what lies behind shows where nothing is known. Where that is, a picture is
// (0, 0, 0, 0), so its colours come out of the filter multiplied by what covers.
export const showFragment = (compare, tiled, hidden) => `#version 300 es
precision highp float;
uniform sampler2D uPicture;
uniform sampler2D uPhotograph;
uniform sampler2D uRamp;
uniform float uSplit;  // columns of the canvas from which on the photograph is shown
uniform float uMost;   // CIEDE2000 at the end of the ramp
in vec2 vTexture;
in vec2 vPainting;
out vec4 shown;

${compare === "difference" ? DIFFERENCE : ""}
void main() {
  vec4 picture = texture(uPicture, vTexture);
${hidden ? "  if (picture.a == 0.0) discard;\n" : ""}  shown = picture;
${compare ? `  if (gl_FragCoord.x >= uSplit) {
    vec3 photograph = texture(uPhotograph, ${tiled ? "vTexture" : "vPainting"}).rgb;
    shown = vec4(photograph, 1.0);
${compare === "difference" ? `    float found = difference(lab(picture.rgb), lab(photograph));
    shown = texelFetch(uRamp, ivec2(int(clamp(found / uMost, 0.0, 1.0) * 255.0 + 0.5), 0), 0);` : ""}
  }` : ""}
}`;
