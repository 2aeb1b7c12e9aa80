// Relightable images of other programs: a picture is a sum of planes, weighted by functions of the light's direction.
// Polynomial texture maps [malzbender2001polynomial], hemispherical [gautron2004hemispherical] and spherical harmonics,
// Gaussians about the photographs' lights [ponchio2018compact].

const GRAZING = Math.sin(0.01); // height above which hemispherical harmonics change
const FAINT = 0.001; // radial functions of less weight are left out

const FUNCTIONS = {
  ptm: (_, [x, y]) => [1, x, y, x * x, x * y, y * y],
  hsh: (_, [x, y, z]) => {
    const c = Math.max(z, GRAZING), s = Math.sqrt(c - c * c), phi = Math.atan2(y, x), pi = Math.PI;
    return [
      Math.sqrt(1 / (2 * pi)),
      Math.sqrt(6 / pi) * s * Math.cos(phi), Math.sqrt(3 / (2 * pi)) * (2 * c - 1), Math.sqrt(6 / pi) * s * Math.sin(phi),
      Math.sqrt(30 / pi) * (c * c - c) * Math.cos(2 * phi), Math.sqrt(30 / pi) * (2 * c - 1) * s * Math.cos(phi),
      Math.sqrt(5 / (2 * pi)) * (6 * c * c - 6 * c + 1),
      Math.sqrt(30 / pi) * (2 * c - 1) * s * Math.sin(phi), Math.sqrt(30 / pi) * (c * c - c) * Math.sin(2 * phi),
    ];
  },
  sh: (_, [x, y, z]) => {
    const first = Math.sqrt(3 / (4 * Math.PI)), second = Math.sqrt(15 / (4 * Math.PI));
    return [Math.sqrt(1 / (4 * Math.PI)), first * y, first * z, first * x, second * x * y, second * y * z,
      Math.sqrt(5 / (16 * Math.PI)) * (3 * z * z - 1), second * x * z, 0.5 * second * (x * x - y * y)];
  },
  rbf: ({ lights, sigma }, at) => {
    const squared = lights.map(light => light.reduce((sum, value, i) => sum + (value - at[i]) ** 2, 0));
    const nearest = Math.min(...squared);
    const normalised = weights => {
      const sum = weights.reduce((total, value) => total + value, 0);
      return weights.map(value => value / sum);
    };
    return normalised(normalised(squared.map(value => Math.exp((nearest - value) / sigma ** 2))).map(value => (value < FAINT ? 0 : value)));
  },
};

// What each plane's code adds to red, green and blue under a light, and in a last row what no plane adds: four numbers
// a row, as a texture has them.
export function planeWeights(basis, direction) {
  const { scale, bias, colourspace, components } = basis, count = scale.length;
  const values = FUNCTIONS[basis.kind](basis, direction).slice(0, basis.terms);
  const found = new Float32Array(4 * (count + 1)), rest = [0, 0, 0];
  const mixed = (plane, k) => components[plane].reduce((sum, term, f) => sum + values[f] * term[k], 0);
  for (let k = 0; k < 3; k++) {
    if (colourspace === "mrgb") rest[k] = mixed(0, k);
    for (let plane = 0; plane < count; plane++) {
      let weight = 0;
      if (colourspace === "mrgb") weight = mixed(plane + 1, k);
      else if (colourspace === "lrgb") weight = values[plane];
      else if (plane % 3 === k) weight = values[(plane - k) / 3];
      found[4 * plane + k] = weight * scale[plane];
      rest[k] += weight * bias[plane];
    }
    found[4 * count + k] = rest[k];
  }
  return found;
}

// GLSL of the sum, in linear light. `read` gives a plane.
export function weightedSum({ scale, colourspace, coding }, read) {
  const weight = row => `texelFetch(uWeights, ivec2(${row}, 0), 0).rgb`;
  return `vec3 colour = ${weight(scale.length)};
${scale.map((_, plane) => `  colour += ${read(`code${plane}`)} * ${weight(plane)};`).join("\n")}
${colourspace === "lrgb" ? `  colour *= vec3(${["red", "green", "blue"].map(read).join(", ")}) / 255.0;` : ""}
${coding === "srgb" ? "  colour = decoded(colour);" : ""}`;
}

export const DECODED = `
vec3 decoded(vec3 code) {
  return mix(code / 12.92, pow(max(code + 0.055, 0.0) / 1.055, vec3(2.4)), step(0.04045, code));
}`;

// The sum for one pixel: red, green and blue as the file has them.
export function pixelSum(basis, direction, read) {
  const weights = planeWeights(basis, direction), last = 4 * basis.scale.length;
  return [0, 1, 2].map(k => {
    let sum = weights[last + k];
    basis.scale.forEach((_, plane) => { sum += read(`code${plane}`) * weights[4 * plane + k]; });
    return basis.colourspace === "lrgb" ? sum * read(["red", "green", "blue"][k]) / 255 : sum;
  });
}
