// What is known of one pixel, and its lobes as functions: the formulas of the shader, for plots.

import { clamp } from "./numbers.js";
import { applied, encodeSrgb, labFromXyz } from "./colour.js";
import { pixelSum } from "./basis.js";
import { groupsOf, numberAt } from "./half.js";
import { anglesOf } from "./state.js";

// The numbers that make the shape of a lobe.
export const shapeNames = doc => (doc.model === "lafortune" ? ["cxy", "cz", "exponent"] : ["gamma"]);

export function pixelValues(doc, buffer, size, column, row) {
  const texels = size.width * size.height, texel = row * size.width + column;
  const views = groupsOf(doc.groups, buffer, texels);
  const read = name => numberAt(doc.groups, views, texels, name, texel);
  const flags = read("flags"), shown = flags >= doc.shown;
  const status = doc.statuses[shown ? flags - doc.shown : flags];
  if (!shown) return { status, shown };
  if (doc.basis) return { shown, relit: direction => pixelSum(doc.basis, direction, read) };
  const normal = ["x", "y", "z"].map(name => read(name) / doc.unit);
  const many = (prefix, count) => Array.from({ length: count }, (_, k) => read(prefix + k));
  const diffuse = many("diffuse", doc.coefficients);
  const lobes = doc.lobes.map((lobe, number) => ({
    strength: many(`strength${number}_`, lobe.tinted ? doc.coefficients : 1),
    shape: shapeNames(doc).map(name => read(name + number)),
  })).filter(lobe => lobe.strength.some(value => value !== 0));
  return { status, shown, normal, ...anglesOf(normal), diffuse, lobes, height: doc.relief ? read("height") : null, quality: Object.fromEntries(doc.quality.map(name => [name, read(name)])) };
}

// The 1st and 99th percentile of what layers show on ramps, the statuses that there are, and whether anything is known,
// of a tile.
export function rangesOf(doc, buffer, size) {
  const found = { width: [], strength: [], height: [] }, statuses = new Set(), ranges = {};
  if (doc.basis) return { ranges, statuses: [], known: true };
  let known = false;
  const step = Math.max(1, Math.floor(size.width * size.height / 4000));
  for (let texel = 0; texel < size.width * size.height; texel += step) {
    const one = pixelValues(doc, buffer, size, texel % size.width, Math.floor(texel / size.width));
    if (one.status) statuses.add(Number(Object.keys(doc.statuses).find(code => doc.statuses[code] === one.status)));
    if (!one.shown) continue;
    known = true;
    if (doc.relief) found.height.push(one.height);
    const luminance = doc.colours.illuminants[0].diffuse[1];
    let most = 0, best = null;
    for (const lobe of one.lobes) {
      const strength = lobe.strength.length > 1 ? lobe.strength.reduce((sum, value, k) => sum + luminance[k] * value, 0) : lobe.strength[0];
      const width = doc.model === "lafortune" ? 0.5 * Math.acos(0.5 ** (1 / Math.max(lobe.shape[2], 1e-3))) : lobe.shape[0];
      if (strength * width * width > most) [most, best] = [strength * width * width, [width, strength]];
    }
    if (best) {
      found.width.push(Math.log2(best[0]));
      found.strength.push(Math.log2(best[1]));
    }
  }
  for (const [name, values] of Object.entries(found)) {
    if (!values.length) continue;
    values.sort((a, b) => a - b);
    const [low, high] = [0.01, 0.99].map(share => values[Math.floor(share * (values.length - 1))]);
    ranges[name] = high - low > 1e-3 ? [low, high] : [low - 0.5, high + 0.5];
  }
  return { ranges, statuses: [...statuses].sort((a, b) => a - b), known };
}

export const spectrumOf = (colours, coefficients) =>
  colours.wavelengths.map((_, i) => coefficients.reduce((sum, value, k) => sum + value * colours.basis[k][i], 0));

// How far a spectrum may be off at each wavelength; null: not known.
export function intervalOf({ interval }, spectrum) {
  if (!interval) return null;
  const size = Math.sqrt(spectrum.reduce((sum, value) => sum + value * value, 0) / spectrum.length);
  return interval.spread.map(spread => Math.hypot(spread * size, interval.noise));
}

// Lab, relative to the white of the light, of the diffuse colour in full light.
export function labOf(colours, illuminant, coefficients) {
  const light = colours.illuminants.find(one => one.name === illuminant);
  return labFromXyz(applied(light.diffuse, coefficients), light.interface);
}

export const codesOf = (matrix, coefficients) => applied(matrix, coefficients).map(value => Math.round(255 * encodeSrgb(value)));

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

export function fresnel(c, index) {
  const q = Math.sqrt(index * index + c * c - 1), sum = q + c, difference = q - c;
  const parallel = (c * sum - 1) / (c * difference + 1);
  return 0.5 * (difference / sum) ** 2 * (parallel * parallel + 1);
}

// Radiance of a lobe of unit strength, in the frame of the pixel: the normal is (0, 0, 1).
export function lobeValue(model, shape, index, light, view) {
  const n_l = light[2], n_v = view[2];
  if (n_l <= 0 || n_v <= 0) return 0;
  if (model === "lafortune") {
    const [cxy, cz, exponent] = shape;
    const base = cxy * (light[0] * view[0] + light[1] * view[1]) + cz * n_l * n_v;
    return base > 0 ? n_l * base ** exponent : 0;
  }
  const sum = light.map((value, i) => value + view[i]), extent = Math.hypot(...sum);
  if (extent < 1e-3) return 0;
  const half = sum.map(value => value / extent), v_h = Math.min(extent / 2, 1);
  const width = clamp(shape[0], 5e-4, 1.25);
  const phi = 2 * Math.asin(Math.min(1, Math.hypot(half[0], half[1], half[2] - 1) / 2));
  const masked = 2 / v_h * half[2];
  const attenuation = Math.min(masked, 1 / n_v, masked * n_l / n_v);
  return fresnel(dot(view, half), index) * attenuation * Math.exp(-Math.LN2 * (phi / width) ** 2);
}
