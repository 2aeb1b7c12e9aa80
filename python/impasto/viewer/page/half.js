// Numbers of a tile: half precision, and where a plane lies.

export function fromHalf(bits) {
  const exponent = (bits >> 10) & 31, fraction = bits & 1023, sign = bits & 32768 ? -1 : 1;
  if (exponent === 0) return sign * fraction * 2 ** -24;
  if (exponent === 31) return fraction ? NaN : sign * Infinity;
  return sign * (1 + fraction / 1024) * 2 ** (exponent - 15);
}

const SINGLE = new Float32Array(1), BITS = new Uint32Array(SINGLE.buffer);

// The nearest number in half precision, ties to even; beyond its range the largest, as a picture knows no infinity.
export function toHalf(value) {
  SINGLE[0] = Math.min(Math.max(value, -65504), 65504);
  const bits = BITS[0], sign = bits >>> 16 & 0x8000, size = Math.abs(SINGLE[0]);
  if (!(size > 0)) return sign;
  if (size < 2 ** -14) {
    const steps = size * 2 ** 24, whole = Math.floor(steps), over = steps - whole;
    return sign | whole + (over > 0.5 || (over === 0.5 && whole % 2) ? 1 : 0);
  }
  const rest = bits & 0x1fff, short = (bits >>> 13 & 0x3ffff) - (112 << 10);
  return sign | short + (rest > 0x1000 || (rest === 0x1000 && short & 1) ? 1 : 0);
}

const BYTES = { int16: 2, half: 2, single: 4 };
const ARRAYS = { int16: Int16Array, half: Uint16Array, single: Float32Array };

// Views of the groups of a tile of so many texels, as they are uploaded.
export function groupsOf(layout, buffer, texels) {
  let start = 0;
  const found = layout.map(group => {
    const count = group.layers * texels * 4;
    const view = new ARRAYS[group.number](buffer, start, count);
    start += count * BYTES[group.number];
    return view;
  });
  if (start !== buffer.byteLength) throw new Error(`a tile of ${buffer.byteLength} bytes, expected ${start}`);
  return found;
}

// The number of a plane in a texel.
export function numberAt(layout, views, texels, name, texel) {
  for (let i = 0; i < layout.length; i++) {
    const plane = layout[i].planes.indexOf(name);
    if (plane < 0) continue;
    const value = views[i][((plane >> 2) * texels + texel) * 4 + (plane & 3)];
    return layout[i].number === "half" ? fromHalf(value) : value;
  }
  return NaN;
}
