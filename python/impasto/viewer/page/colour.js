// From reflectance to the display: matrices, incomplete adaptation, colour differences.

import { clamp } from "./numbers.js";

export const product = (a, b) => a.map(row => b[0].map((_, j) => row.reduce((sum, value, i) => sum + value * b[i][j], 0)));
export const applied = (matrix, vector) => matrix.map(row => row.reduce((sum, value, i) => sum + value * vector[i], 0));

export function inverse(m) {
  const [[a, b, c], [d, e, f], [g, h, i]] = m;
  const det = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g);
  return [
    [(e * i - f * h) / det, (c * h - b * i) / det, (b * f - c * e) / det],
    [(f * g - d * i) / det, (a * i - c * g) / det, (c * d - a * f) / det],
    [(d * h - e * g) / det, (b * g - a * h) / det, (a * e - b * d) / det],
  ];
}

// XYZ of a blackbody, Y = 1: Planck's law, eq. 8, on the grid of the matching functions.
export function blackbody(adaptation, kelvin) {
  const power = adaptation.wavelengths.map(nm => {
    const metres = nm * 1e-9;
    return metres ** -5 / Math.expm1(adaptation.second_radiation_constant / (metres * kelvin));
  });
  const xyz = adaptation.matching_functions.map(row => row.reduce((sum, value, i) => sum + value * power[i], 0));
  return xyz.map(value => value / xyz[1]);
}

// Eq. 7: the temperature to which an eye is adapted that has adapted to the degree d, on the mired scale.
export function adaptedTemperature(test, reference, d) {
  if (d === 0) return test;
  if (d === 1) return reference;
  return 1e6 / ((1e6 / reference - 1e6 / test) * d + 1e6 / test);
}

// Eq. 9 to 12: XYZ under the test light to the XYZ that is seen.
export function adaptationMatrix(adaptation, test, d) {
  const cones = adaptation.cones_from_xyz;
  const before = applied(cones, blackbody(adaptation, test));
  const after = applied(cones, blackbody(adaptation, adaptedTemperature(test, adaptation.reference, d)));
  const scaled = cones.map((row, i) => row.map(value => value * after[i] / before[i]));
  return product(inverse(cones), scaled);
}

// The polynomial through values at Chebyshev points of the second kind, by the barycentric formula.
export function interpolated(points, values, at) {
  let above = 0, below = 0;
  for (let i = 0; i < points.length; i++) {
    if (at === points[i]) return values[i];
    const end = i === 0 || i === points.length - 1 ? 0.5 : 1;
    const weight = (i % 2 ? -end : end) / (at - points[i]);
    above += weight * values[i];
    below += weight;
  }
  return above / below;
}

// Way of light through a film in thicknesses, for the cosine of the zenith angle outside.
export const pathThrough = (index, cosine) => 1 / Math.sqrt(Math.max(1e-12, 1 - (1 - cosine * cosine) / (index * index)));

// Matrix from coefficients, and colour of the light, both in linear light of the display, with the exposure at which
// a white board in full light clips no channel.
export function displayColours(colours, { illuminant, adaptation, varnish, cosines, exposure, intensity }) {
  const light = colours.illuminants.find(one => one.name === illuminant) ?? colours.illuminants[0];
  let { diffuse, interface: face } = light;
  if (varnish) {
    const film = varnish.films[light.name];
    const path = pathThrough(varnish.index, cosines[0]) + pathThrough(varnish.index, cosines[1]);
    diffuse = film.diffuse[0].map((row, i) => row.map((_, k) => interpolated(varnish.paths, film.diffuse.map(one => one[i][k]), path)));
    face = film.interface;
  }
  let display = colours.linear_from_xyz;
  if (colours.adaptation && adaptation !== null) {
    display = product(display, adaptationMatrix(colours.adaptation, light.kelvin, adaptation));
  }
  const white = applied(display, face);
  const factor = 2 ** exposure / (Math.max(...white) * intensity);
  return {
    factor,
    diffuse: product(display, diffuse).map(row => row.map(value => factor * value)),
    interface: white.map(value => factor * value),
    xyz: matrix => product(inverse(colours.linear_from_xyz), matrix),
  };
}

// The same of the three channels of an environment, under which a white board that faces the viewer gets `board`.
export function channelColours(colours, { illuminant, adaptation, varnish, exposure, height, board }) {
  const light = colours.illuminants.find(one => one.name === illuminant) ?? colours.illuminants[0];
  let { diffuse, interface: faces } = light.channels;
  if (varnish) {
    // Light of a room comes from everywhere: on average at 60 degrees, whose cosine is 1/2.
    const path = pathThrough(varnish.index, 0.5) + pathThrough(varnish.index, height), { films } = varnish.films[light.name];
    diffuse = diffuse.map((matrix, c) => matrix.map((row, i) => row.map((_, k) => interpolated(varnish.paths, films.map(film => film[c][i][k]), path))));
  }
  let display = colours.linear_from_xyz;
  if (colours.adaptation && adaptation !== null) display = product(display, adaptationMatrix(colours.adaptation, light.kelvin, adaptation));
  faces = faces.map(face => applied(display, face));
  const white = faces[0].map((_, i) => faces.reduce((sum, face, c) => sum + board[c] * face[i], 0));
  const factor = 2 ** exposure / Math.max(...white, 1e-9);
  return { factor, diffuse: diffuse.map(matrix => product(display, matrix).map(row => row.map(value => factor * value))), interface: faces.map(face => face.map(value => factor * value)) };
}

export const encodeSrgb = light => {
  const value = clamp(light, 0, 1);
  return value <= 0.0031308 ? 12.92 * value : 1.055 * value ** (1 / 2.4) - 0.055;
};

export function labFromXyz(xyz, white) {
  const [x, y, z] = xyz.map((value, i) => {
    const t = value / white[i];
    return t > 216 / 24389 ? Math.cbrt(t) : (24389 / 27 * t + 16) / 116;
  });
  return [116 * y - 16, 500 * (x - y), 200 * (y - z)];
}
