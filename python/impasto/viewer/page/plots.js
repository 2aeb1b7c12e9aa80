// Small diagrams of a pixel as SVG: its spectrum, and its lobes in the plane of incidence.

import { clamp } from "./numbers.js";
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

// A diagram with lines at some values; x and y place numbers on it.
function chart(words, [first, last], [least, most], lines, ticks, unit, height = 120, roots = []) {
  const [width, left, below] = [272, 30, 18];
  const x = value => left + (width - left - 6) * (value - first) / (last - first);
  const y = value => 6 + (height - below - 6) * (most - value) / (most - least);
  const picture = svg("svg", { viewBox: `0 0 ${width} ${height}`, role: "img", class: "plot", "aria-label": words });
  for (const [value, at] of [...lines.map(value => [value, y(value)]), ...roots.map(value => [value, y(Math.sqrt(value))])]) {
    picture.append(svg("line", { x1: left, x2: width - 6, y1: at, y2: at, class: "grid" }), label(left - 5, at + 3.5, value, "end"));
  }
  ticks.forEach((value, i) => picture.append(label(Math.min(x(value), width - 16), height - 4, i ? value : `${value}${unit}`, value === first ? "start" : "middle")));
  return { picture, x, y };
}
const stepped = (from, to, step) => Array.from({ length: Math.floor((to - from) / step + 1e-6) + 1 }, (_, i) => Number((from + i * step).toPrecision(6)));

// `half`: of the interval around it, or null.
export function spectrumPlot(wavelengths, values, half) {
  const most = Math.max(1, Math.ceil(5 * Math.max(...values)) / 5), least = Math.min(0, ...values);
  const first = wavelengths[0], last = wavelengths[wavelengths.length - 1];
  const { picture, x, y } = chart(`Reflectance from ${first} to ${last} nm, from ${Math.min(...values).toFixed(2)} to ${Math.max(...values).toFixed(2)}`,
    [first, last], [least, most], [0, 0.5, 1], stepped(Math.ceil(first / 100) * 100, last, 100), " nm");
  const edge = sign => wavelengths.map((nm, i) => [x(nm), y(clamp(values[i] + sign * half[i], least, most))]);
  if (half) picture.append(path([...edge(1), ...edge(-1).reverse()], { class: "band" }));
  picture.append(path(wavelengths.map((nm, i) => [x(nm), y(values[i])]), { class: "curve" }));
  return picture;
}

// Colours of bands: those of their names, others around the circle of hues from blue to red, all as light.
export function bandColour(bands, k) {
  const hue = { red: 27, green: 145, blue: 262 }[bands[k]] ?? (bands.length > 1 ? 270 - 245 * k / (bands.length - 1) : 200);
  return `light-dark(oklch(.47 .15 ${hue}), oklch(.78 .13 ${hue}))`;
}

// What was measured, dots, and what is fitted, rings, over the angle between normal and half vector, with a line from
// one to the other. Clipped samples are triangles, those in shadow crosses. Light goes by its square root: a highlight
// is a hundred times brighter than the matte paint around it. Kinds that there are come back, too.
export function samplePlot({ bands, angle, measured, fitted, clipped, shadowed, residual }) {
  const root = value => Math.sign(value) * Math.sqrt(Math.abs(value));
  const values = [measured, fitted].flat(2).filter(Number.isFinite), top = Math.max(...values, 1e-3), low = Math.min(...values, 0);
  const wide = Math.min(90, 10 * Math.ceil(Math.max(...angle, 1) / 10)), count = measured.flat().filter(Number.isFinite).length;
  const lines = [];
  for (let power = Math.ceil(Math.log10(top)); power > -4; power--) for (const digit of [5, 2, 1]) {
    const value = Number(`${digit}e${power}`), least = root(lines.at(-1) ?? Infinity) - 0.17 * root(top);
    if (value <= top && root(value) < least && root(value) > 0.14 * root(top)) lines.push(value);
  }
  const { picture, x, y: placed } = chart(`${count} samples in linear light by the angle between normal and half vector, 0 to ${wide} degrees; up to ${top.toPrecision(2)}${residual === null ? "" : `, the fit is ${(100 * residual).toPrecision(2)} % of the brightest away`}`,
    [0, wide], [root(low), root(top)], [0], stepped(0, wide, wide > 50 ? 20 : 10), "°", 160, lines);
  const y = value => placed(root(value));
  const kinds = new Set();
  bands.forEach((band, k) => {
    const group = svg("g", { class: "samples" });
    group.style.setProperty("--band", bandColour(bands, k));
    angle.forEach((degrees, i) => {
      const [one, fit] = [measured[i][k], fitted[i][k]];
      if (one === null) return;
      const kind = clipped[i][k] ? "clipped" : shadowed[i] ? "shadowed" : "measured", [at, from, to] = [x(degrees), y(one), y(fit)];
      kinds.add(kind);
      const mark = { clipped: `M${at - 2.6} ${from + 2}h5.2l-2.6 -4.6z`, shadowed: `M${at - 2} ${from - 2}l4 4m0 -4l-4 4`, measured: `M${at} ${from}h0` }[kind];
      group.append(svg("line", { x1: at, x2: at, y1: from, y2: to }), svg("circle", { cx: at, cy: to, r: 2.2 }),
        svg("path", { d: mark, class: kind }, svg("title", {}, `No. ${i + 1}, ${band}: ${one.toPrecision(3)}, fitted ${fit.toPrecision(3)}`)));
    });
    picture.append(group);
  });
  return { picture, kinds };
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
