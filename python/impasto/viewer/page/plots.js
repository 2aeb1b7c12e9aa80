// Small diagrams of a pixel as SVG: its spectrum, and its lobes in the plane of incidence.

import { lobeValue } from "./values.js";

const SVG = "http://www.w3.org/2000/svg";
export function svg(name, attributes = {}, ...children) {
  const made = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.append(...children);
  return made;
}

const path = (points, attributes) =>
  svg("path", { d: `M${points.map(point => point.map(value => value.toFixed(2)).join(" ")).join("L")}`, fill: "none", ...attributes });
const label = (x, y, text, anchor = "middle") => svg("text", { x, y, "text-anchor": anchor, class: "tick" }, text);

export function spectrumPlot(wavelengths, values) {
  const [width, height, left, below] = [272, 120, 26, 18];
  const most = Math.max(1, Math.ceil(5 * Math.max(...values)) / 5), least = Math.min(0, ...values);
  const first = wavelengths[0], last = wavelengths[wavelengths.length - 1];
  const x = nm => left + (width - left - 6) * (nm - first) / (last - first);
  const y = value => 6 + (height - below - 6) * (most - value) / (most - least);
  const picture = svg("svg", { viewBox: `0 0 ${width} ${height}`, role: "img", class: "plot",
    "aria-label": `Reflectance from ${first} to ${last} nm, from ${Math.min(...values).toFixed(2)} to ${Math.max(...values).toFixed(2)}` });
  for (const value of [0, 0.5, 1]) {
    picture.append(svg("line", { x1: left, x2: width - 6, y1: y(value), y2: y(value), class: "grid" }), label(left - 5, y(value) + 3.5, value, "end"));
  }
  for (let nm = Math.ceil(first / 100) * 100; nm <= last; nm += 100) picture.append(label(Math.min(x(nm), width - 16), height - 4, nm === Math.ceil(first / 100) * 100 ? `${nm} nm` : nm, nm === first ? "start" : "middle"));
  picture.append(path(wavelengths.map((nm, i) => [x(nm), y(values[i])]), { class: "curve" }));
  return picture;
}

// Light from 45 degrees at the left; the radius is the radiance towards each direction. `neutral` weighs bands.
export function lobePlot(doc, pixel, neutral) {
  const [width, height] = [272, 140], middle = [width / 2, height - 16], reach = 116;
  const incidence = Math.PI / 4, light = [-Math.sin(incidence), 0, Math.cos(incidence)];
  const diffuse = neutral(pixel.diffuse);
  const strength = lobe => (lobe.strength.length > 1 ? neutral(lobe.strength) : lobe.strength[0]);
  const angles = Array.from({ length: 361 }, (_, i) => (i / 360 - 0.5) * Math.PI);
  const parts = pixel.lobes.map(lobe => angles.map(angle =>
    strength(lobe) * lobeValue(doc.model, lobe.shape, doc.index, light, [Math.sin(angle), 0, Math.cos(angle)])));
  const matte = Math.max(diffuse, 0) * light[2];
  const total = angles.map((_, i) => matte + parts.reduce((sum, part) => sum + part[i], 0));
  const most = Math.max(...total, 1e-6);
  const curve = (values, attributes) => path(angles.map((angle, i) => {
    const r = reach * Math.max(values[i], 0) / most;
    return [middle[0] + r * Math.sin(angle), middle[1] - r * Math.cos(angle)];
  }), attributes);
  const picture = svg("svg", { viewBox: `0 0 ${width} ${height}`, role: "img", class: "plot",
    "aria-label": `Reflected light by direction, lamp at 45 degrees: ${(most / Math.max(matte, 1e-6)).toPrecision(2)} times the matte part at its strongest` });
  picture.append(
    svg("line", { x1: 8, x2: width - 8, y1: middle[1], y2: middle[1], class: "grid" }),
    svg("line", { x1: middle[0], x2: middle[0] + reach * light[0], y1: middle[1], y2: middle[1] - reach * light[2], class: "ray" }),
    label(middle[0] + reach * light[0] - 4, middle[1] - reach * light[2] - 4, "lamp"),
    curve(angles.map(() => matte), { class: "matte" }),
    curve(total, { class: "curve" }),
    label(middle[0], height - 4, "matte part dashed"),
  );
  return picture;
}
