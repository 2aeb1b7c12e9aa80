// What is known of one pixel, and its lobes as functions: the formulas of the shader, for plots.

import { applied, encodeSrgb, labFromXyz } from "./colour.js";
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
  const normal = ["x", "y", "z"].map(name => read(name) / doc.unit);
  const many = (prefix, count) => Array.from({ length: count }, (_, k) => read(prefix + k));
  const diffuse = many("diffuse", doc.coefficients);
  const lobes = doc.lobes.map((lobe, number) => ({
    strength: many(`strength${number}_`, lobe.tinted ? doc.coefficients : 1),
    shape: shapeNames(doc).map(name => read(name + number)),
  })).filter(lobe => lobe.strength.some(value => value !== 0));
  return { status, shown, normal, ...anglesOf(normal), diffuse, lobes, height: doc.relief ? read("height") : null };
}

export const spectrumOf = (colours, coefficients) =>
  colours.wavelengths.map((_, i) => coefficients.reduce((sum, value, k) => sum + value * colours.basis[k][i], 0));

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
  const width = Math.min(Math.max(shape[0], 5e-4), 1.25);
  const phi = 2 * Math.asin(Math.min(1, Math.hypot(half[0], half[1], half[2] - 1) / 2));
  const masked = 2 / v_h * half[2];
  const attenuation = Math.min(masked, 1 / n_v, masked * n_l / n_v);
  return fresnel(dot(view, half), index) * attenuation * Math.exp(-Math.LN2 * (phi / width) ** 2);
}
