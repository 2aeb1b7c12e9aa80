// Light from all directions: a map as the page gets it, turned, and as distant lamps.

import { clamp } from "./numbers.js";
import { fromHalf } from "./half.js";

const BRIGHT = 0.001, MOST_BRIGHT = 96; // share of all light of a texel that is a lamp, and how many may be
const COARSE = 16; // texels along a face, whose light is one distant lamp each in irradiance
const FACES = [[[0, 0, -1], [0, -1, 0], [1, 0, 0]], [[0, 0, 1], [0, -1, 0], [-1, 0, 0]], [[1, 0, 0], [0, 0, 1], [0, 1, 0]],
  [[1, 0, 0], [0, 0, -1], [0, -1, 0]], [[1, 0, 0], [0, -1, 0], [0, 0, 1]], [[-1, 0, 0], [0, -1, 0], [0, 0, -1]]];

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
    this.linear = Float32Array.from({ length: 65536 }, (_, bits) => fromHalf(bits));
    this.lamps = [];
  }

  // Face by face: between them the browser does what else there is.
  static async read(record, buffer) {
    const made = new EnvironmentMap(record, buffer), bright = [];
    for (let face = 0; face < 6; face++) {
      bright.push(...made.readFace(face));
      await new Promise(done => setTimeout(done));
    }
    const total = bright.reduce((sum, [power]) => sum + power, 0);
    made.bright = bright.filter(([power]) => power > BRIGHT * total).sort(([one], [other]) => other - one).slice(0, MOST_BRIGHT)
      .map(([, at, light, towards]) => ({ at, light, towards }));
    return made;
  }

  readFace(face) {
    const { record: { side, scale }, linear, texels } = this, across = Math.min(COARSE, side), size = side / across, found = [];
    const [right, down, out] = FACES[face], sums = Array.from({ length: across * across }, () => new Float64Array(6));
    for (let row = 0; row < side; row++) for (let column = 0; column < side; column++) {
      const s = 2 * (column + 0.5) / side - 1, t = 2 * (row + 0.5) / side - 1, far = Math.sqrt(1 + s * s + t * t);
      const at = 3 * (face * side * side + row * side + column), solid = scale * 4 / (side * side * far ** 3);
      const [red, green, blue] = [0, 1, 2].map(channel => solid * linear[texels[at + channel]]), sum = sums[Math.min(Math.floor(row / size), across - 1) * across + Math.min(Math.floor(column / size), across - 1)];
      const power = 0.2126 * red + 0.7152 * green + 0.0722 * blue, weight = (power + 1e-12) / far, towards = [0, 1, 2].map(i => (s * right[i] + t * down[i] + out[i]) / far);
      found.push([power, at, [red, green, blue], towards]);
      sum[0] += red;
      sum[1] += green;
      sum[2] += blue;
      for (let i = 0; i < 3; i++) sum[3 + i] += weight * far * towards[i];
    }
    for (const [red, green, blue, ...towards] of sums) {
      const length = Math.hypot(...towards);
      if (length > 0 && red + green + blue > 0) this.lamps.push({ light: [red, green, blue], towards: towards.map(value => value / length) });
    }
    return found;
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
      const above = clamp(0.5 + direction[2] / width, 0, 1);
      return { direction, light: light.map(value => above * value) };
    }).filter(one => one.light.some(value => value > 0));
  }

  // Irradiance of a board that faces the viewer.
  board(degrees) {
    return this.seen(degrees).reduce((sum, { direction, light }) => sum.map((value, i) => value + Math.max(direction[2], 0) * light[i]), [0, 0, 0]);
  }
}
