// Pictures in linear light as OpenEXR: half precision, uncompressed, one line after another.

import { toHalf } from "./half.js";

const CHANNELS = ["B", "G", "R"]; // in the order of their names, as the format asks for
const HALF = 1;

// Where a pixel of a picture that was turned counterclockwise by quarters lies in the picture.
function turnedFrom(x, y, { width, height }, turns) {
  return [[x, y], [width - 1 - y, x], [width - 1 - x, height - 1 - y], [y, height - 1 - x]][turns];
}

// Attributes of the header: name, type and bytes of each.
function header(width, height) {
  const text = words => new TextEncoder().encode(`${words}\0`);
  const numbers = (kind, ...values) => new Uint8Array(new kind(values).buffer);
  const channel = name => [text(name), numbers(Int32Array, HALF, 0, 1, 1)];
  const window = numbers(Int32Array, 0, 0, width - 1, height - 1);
  const attributes = [
    ["channels", "chlist", [...CHANNELS.flatMap(channel), new Uint8Array(1)]],
    ["compression", "compression", [new Uint8Array(1)]],
    ["dataWindow", "box2i", [window]],
    ["displayWindow", "box2i", [window]],
    ["lineOrder", "lineOrder", [new Uint8Array(1)]],
    ["pixelAspectRatio", "float", [numbers(Float32Array, 1)]],
    ["screenWindowCenter", "v2f", [numbers(Float32Array, 0, 0)]],
    ["screenWindowWidth", "float", [numbers(Float32Array, 1)]],
  ];
  const parts = attributes.flatMap(([name, type, values]) => {
    const size = values.reduce((sum, value) => sum + value.length, 0);
    return [text(name), text(type), numbers(Int32Array, size), ...values];
  });
  return [numbers(Int32Array, 20000630, 2), ...parts, new Uint8Array(1)];
}

// `light`: `(y, x, 4)` single precision, the fourth above 0 where the painting is. Elsewhere a picture is black.
export function exr(light, size, turns = 0) {
  const [width, height] = turns % 2 ? [size.height, size.width] : [size.width, size.height];
  const first = header(width, height), start = first.reduce((sum, part) => sum + part.length, 0);
  const line = 8 + 2 * CHANNELS.length * width, offsets = new BigUint64Array(height);
  for (let y = 0; y < height; y++) offsets[y] = BigInt(start + 8 * height + y * line);
  const body = new DataView(new ArrayBuffer(height * line));
  for (let y = 0; y < height; y++) {
    body.setInt32(y * line, y, true);
    body.setInt32(y * line + 4, line - 8, true);
    for (let x = 0; x < width; x++) {
      const [column, row] = turnedFrom(x, y, size, turns), at = 4 * (row * size.width + column);
      for (let i = 0; i < 3; i++) body.setUint16(y * line + 8 + 2 * (i * width + x), light[at + 3] > 0 ? toHalf(light[at + 2 - i]) : 0, true);
    }
  }
  return new Blob([...first, new Uint8Array(offsets.buffer), body.buffer], { type: "image/x-exr" });
}
