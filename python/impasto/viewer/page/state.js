// What the page shows, as one object, and as the text behind # in its address.

import { clamp } from "./numbers.js";

const RADIANS = Math.PI / 180;

export const directionOf = (azimuth, elevation) => {
  const across = Math.cos(elevation * RADIANS);
  return [across * Math.cos(azimuth * RADIANS), across * Math.sin(azimuth * RADIANS), Math.sin(elevation * RADIANS)];
};

export const anglesOf = ([x, y, z]) => ({
  azimuth: (Math.atan2(y, x) / RADIANS + 360) % 360,
  elevation: Math.atan2(z, Math.hypot(x, y)) / RADIANS,
});

export const LOWEST = 2;

// Layers of how far a fit can be trusted, on ramps that are the same for every painting. `ends`: of the ramp, as
// powers of two; `words` of its ends; `shown`: a number in words.
export const QUALITY = {
  sigma: { label: "Uncertainty of the normal", ends: [0.1, 10].map(value => Math.log2(value * RADIANS)), words: ["0.1°", "10°"], shown: value => `${(value / RADIANS).toPrecision(2)}°` },
  residual: { label: "Residual", ends: [0.001, 0.1].map(Math.log2), words: ["0.1 % of white", "10 %"], shown: value => `${(100 * value).toPrecision(2)} % of white` },
};

export function firstState(doc) {
  return {
    ...anglesOf(doc.light),
    environment: "none", // by name; none: a lamp
    rotation: 0, // degrees by which the environment is turned
    near: null, // mm from the painting's middle to a near lamp; null: a distant one
    illuminant: doc.colours.illuminants[0].name,
    adaptation: null,
    exposure: 0,
    clipped: false, // whether colours that the display cannot show are marked
    layer: "picture",
    matte: true,
    gloss: true,
    ambient: true,
    varnish: "none",
    tilt: 0,
    towards: 0,
    relief: 1,
    turns: 0, // quarter turns of the picture on the page, counterclockwise
    photograph: -1,
    against: Boolean(doc.against), // whether the other painting is beside it
    compare: "photograph",
    split: 0.5,
    view: null,
    pixel: null,
  };
}

const short = (value, digits = 2) => String(Number(value.toFixed(digits)));

export function textOfState(state, doc) {
  const first = firstState(doc), words = [];
  const add = (name, text) => words.push(`${name}=${text}`);
  add("light", `${short(state.azimuth)},${short(state.elevation)}`);
  if (state.environment !== "none") add("environment", `${encodeURIComponent(state.environment)},${short(state.rotation)}`);
  if (state.near !== null) add("near", short(state.near));
  if (state.illuminant !== first.illuminant) add("illuminant", encodeURIComponent(state.illuminant));
  if (state.adaptation !== null) add("d", short(state.adaptation, 3));
  if (state.exposure) add("ev", short(state.exposure));
  if (state.clipped) add("clipped", "1");
  if (state.layer !== "picture") add("layer", state.layer);
  const off = ["matte", "gloss", "ambient"].filter(name => !state[name]);
  if (off.length) add("off", off.join(","));
  if (state.varnish !== "none") add("varnish", state.varnish);
  if (state.tilt) add("eye", `${short(state.towards)},${short(state.tilt)}`);
  if (state.turns) add("turns", String(state.turns));
  if (state.relief !== 1) add("relief", short(state.relief));
  if (state.photograph >= 0) add("photograph", `${state.photograph},${state.compare},${short(state.split, 3)}`);
  if (state.against) add("against", `${state.compare},${short(state.split, 3)}`);
  else if (first.against) add("against", "none");
  if (state.view) add("view", state.view.map(value => short(value, 4)).join(","));
  if (state.pixel) add("pixel", state.pixel.join(","));
  return words.join("&");
}

// Whatever the text is, a state that can be shown comes out: a link may be old, cut or made up.
export function stateOfText(text, doc) {
  const state = firstState(doc);
  const given = new Map(text.replace(/^#/, "").split("&").map(word => {
    const at = word.indexOf("=");
    return at < 0 ? [word, ""] : [word.slice(0, at), word.slice(at + 1)];
  }));
  const numbers = (name, limits) => {
    const values = (given.get(name) ?? "").split(",").map(word => (word === "" ? NaN : Number(word)));
    if (values.length !== limits.length || !values.every(Number.isFinite)) return null;
    return values.map((value, i) => clamp(value, limits[i][0], limits[i][1]));
  };
  const one = (name, allowed, usual) => (allowed.includes(given.get(name)) ? given.get(name) : usual);
  const light = numbers("light", [[-360, 720], [LOWEST, 90]]);
  if (light) [state.azimuth, state.elevation] = [(light[0] + 360) % 360, light[1]];
  const [room, rotation] = (given.get("environment") ?? "").split(",");
  if (doc.environments.some(one => encodeURIComponent(one.name) === room)) {
    state.environment = decodeURIComponent(room);
    if (rotation && Number.isFinite(Number(rotation))) state.rotation = (Number(rotation) % 360 + 360) % 360;
  }
  if (doc.pitch) state.near = numbers("near", [[1, 1e6]])?.[0] ?? null;
  state.illuminant = one("illuminant", doc.colours.illuminants.map(light => light.name), state.illuminant);
  if (doc.colours.adaptation) state.adaptation = numbers("d", [[0, 1]])?.[0] ?? null;
  state.exposure = numbers("ev", [[-4, 4]])?.[0] ?? 0;
  state.clipped = given.get("clipped") === "1";
  state.layer = one("layer", layersOf(doc).map(layer => layer.name), "picture");
  for (const name of (given.get("off") ?? "").split(",")) if (["matte", "gloss", "ambient"].includes(name)) state[name] = false;
  state.varnish = one("varnish", doc.colours.varnishes.map(coat => coat.name), "none");
  const eye = numbers("eye", [[-360, 720], [0, 75]]);
  if (eye && eye[1] > 0) [state.towards, state.tilt] = [(eye[0] + 360) % 360, eye[1]];
  state.turns = Math.round(numbers("turns", [[0, 3]])?.[0] ?? 0);
  state.relief = numbers("relief", [[0, 10]])?.[0] ?? 1;
  const beside = (compare, split) => {
    if (compare === "difference") state.compare = compare;
    if (split && Number.isFinite(Number(split))) state.split = clamp(Number(split), 0, 1);
  };
  const [number, ...photographed] = (given.get("photograph") ?? "").split(",");
  if (doc.against && given.has("against")) {
    const words = given.get("against").split(",");
    state.against = words[0] !== "none";
    if (state.against) beside(...words);
  }
  if (/^\d+$/.test(number) && Number(number) < doc.photographs.length) {
    [state.photograph, state.against] = [Number(number), false];
    beside(...photographed);
  }
  state.view = numbers("view", [[-doc.width, 2 * doc.width], [-doc.height, 2 * doc.height], [1e-4, 256]]);
  const pixel = numbers("pixel", [[0, doc.width - 1], [0, doc.height - 1]]);
  if (pixel) state.pixel = pixel.map(Math.round);
  return state;
}

export function layersOf(doc) {
  if (doc.basis) return [{ name: "picture", label: "Picture" }];
  return [
    { name: "picture", label: "Picture" },
    { name: "colour", label: "Colours" },
    { name: "normals", label: "Normals" },
    ...(doc.lobes.length ? [{ name: "width", label: "Gloss: width" }, { name: "strength", label: "Gloss: strength" }] : []),
    ...(doc.relief ? [{ name: "height", label: "Height" }] : []),
    ...doc.quality.map(name => ({ name, ...QUALITY[name] })),
    { name: "status", label: "Status" },
  ];
}
