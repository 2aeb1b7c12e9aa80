// The panel beside the painting: every control reads the state and asks for a new one.

import { clamp } from "./numbers.js";
import { adaptedTemperature, encodeSrgb } from "./colour.js";
import { rotationOf } from "./environment.js";
import { LOWEST, QUALITY, directionOf, anglesOf, layersOf } from "./state.js";
import { MOST_DIFFERENCE } from "./renderer.js";
import { svg } from "./plots.js";
import { button, check, choice, degrees, faint, h, heightWords, section, sideOf, slider, unfold } from "./elements.js";
import { pixelSection } from "./inspector.js";
import { placeOf, textOf } from "./annotations.js";

export const lightWords = (azimuth, elevation) => `Light ${elevation > 84 ? "in front" : `from ${sideOf(azimuth)}`}, ${degrees(elevation)} high`;

export const roomWords = (doc, { environment, rotation }) => `${doc.environments.find(one => one.name === environment).label}${rotation ? `, turned by ${Math.round(rotation > 180 ? rotation - 360 : rotation)}°` : ""}`;

// The direction of the lamp: that of a photograph, while one is beside the picture.
const lampOf = (app, state) => (state.photograph < 0 ? state : anglesOf(app.renderer.geometry(state).towards));

// The sky above the painting, seen from in front: the middle is in front, the edge grazes.
function dome(app) {
  const size = 168, middle = size / 2, reach = 76;
  const dot = svg("circle", { r: 8, class: "lamp" });
  const picture = svg("svg", { viewBox: `0 0 ${size} ${size}`, class: "dome", tabindex: 0, role: "slider", "aria-label": "Direction of the light",
    "aria-valuemin": 0, "aria-valuemax": 360 });
  for (const elevation of [0, 30, 60]) picture.append(svg("circle", { cx: middle, cy: middle, r: reach * Math.cos(elevation * Math.PI / 180), class: "ring" }));
  picture.append(svg("line", { x1: middle - reach, x2: middle + reach, y1: middle, y2: middle, class: "ring" }),
    svg("line", { x1: middle, x2: middle, y1: middle - reach, y2: middle + reach, class: "ring" }), dot);
  const move = event => {
    const box = picture.getBoundingClientRect(), scale = size / box.width / reach;
    app.lightAt((event.clientX - box.left - box.width / 2) * scale, -(event.clientY - box.top - box.height / 2) * scale);
  };
  picture.addEventListener("pointerdown", event => { picture.setPointerCapture(event.pointerId); move(event); });
  picture.addEventListener("pointermove", event => picture.hasPointerCapture(event.pointerId) && move(event));
  picture.addEventListener("lostpointercapture", () => app.rest());
  picture.addEventListener("keydown", event => app.lightKey(event));
  return { element: picture, update: state => {
    const lamp = lampOf(app, state), azimuth = app.onPage(lamp.azimuth), [x, y] = directionOf(azimuth, lamp.elevation);
    dot.setAttribute("cx", middle + reach * x);
    dot.setAttribute("cy", middle - reach * y);
    picture.setAttribute("aria-valuenow", Math.round(azimuth));
    picture.setAttribute("aria-valuetext", lightWords(azimuth, lamp.elevation));
  } };
}

// An environment as somebody at the painting sees it who looks into the room; it is turned by dragging.
function roomView(app) {
  const picture = h("canvas", { className: "room", "aria-hidden": "true" });
  let last = "", from = null;
  picture.addEventListener("pointerdown", event => { picture.setPointerCapture(event.pointerId); from = event.clientX; });
  picture.addEventListener("pointermove", event => {
    if (from === null) return;
    app.rotate(180 * (from - event.clientX) / picture.clientWidth);
    from = event.clientX;
  });
  picture.addEventListener("lostpointercapture", () => { from = null; app.rest(); });
  return { element: picture, update: state => {
    const height = app.moves ? 48 : 96, width = 2 * height;
    const room = app.renderer.environments.get(state.environment), key = `${state.environment} ${state.rotation} ${height} ${Boolean(room)}`;
    picture.hidden = state.environment === "none";
    if (key === last || !room) return;
    last = key;
    Object.assign(picture, { width, height });
    const data = new ImageData(width, height), most = Math.max(...room.board(state.rotation)) * room.front(state.rotation), rows = rotationOf(room.record, state.rotation);
    for (let y = 0; y < height; y++) for (let x = 0; x < width; x++) {
      const longitude = ((x + 0.5) / width - 0.5) * Math.PI, latitude = (0.5 - (y + 0.5) / height) * Math.PI / 2, flat = Math.cos(latitude);
      const towards = [-Math.sin(longitude) * flat, Math.sin(latitude), Math.cos(longitude) * flat];
      const light = room.at([0, 1, 2].map(i => rows[0][i] * towards[0] + rows[1][i] * towards[1] + rows[2][i] * towards[2]));
      data.data.set([...light.map(value => 255 * encodeSrgb(1.5 * value / (most + value))), 255], 4 * (y * width + x));
    }
    picture.getContext("2d").putImageData(data, 0, 0);
  } };
}

function lightSection(app, updates) {
  const { doc } = app, pad = dome(app);
  const number = (text, name, low, high, from = value => value, to = value => value) => {
    const input = h("input", { type: "number", min: low, max: high, step: 1, "aria-label": text,
      onchange: () => Number.isFinite(input.valueAsNumber) && app.set({ [name]: from(clamp(input.valueAsNumber, low, high)), photograph: -1 }) });
    updates.push(state => { if (input.getRootNode().activeElement !== input) input.value = Math.round(to(lampOf(app, state)[name])); });
    return h("label", {}, `${text} (°)`, input);
  };
  const preset = (text, azimuth, elevation, words = null) => button(text, () => app.lamp(azimuth, elevation), { title: words ?? "", "aria-label": words });
  const exposure = slider("Exposure", { min: -3, max: 3, step: 0.1 }, value => app.set({ exposure: value }), value => `${value > 0 ? "+" : ""}${value.toFixed(1)} stops`);
  const clipped = check("Mark what is clipped", on => app.set({ clipped: on }));
  const marks = faint("Red stripes: brighter than the display's white. Blue: more saturated than it can show.");
  updates.push(pad.update, state => {
    exposure.update(state.exposure);
    clipped.update(state.clipped);
    marks.hidden = !state.clipped;
  });
  const near = [];
  // What a relightable image holds depends on the direction of the light alone.
  if (doc.pitch && !doc.basis) {
    const extent = Math.hypot(doc.width, doc.height) * doc.pitch;
    const first = Math.round(1.5 * extent);
    const lamp = check("Near lamp", on => app.set({ near: on ? first : null, photograph: -1 }));
    const distance = slider("Distance", { min: Math.log10(0.15 * extent), max: Math.log10(8 * extent), step: 0.01 },
      value => app.set({ near: 10 ** value }), value => `${(10 ** value).toPrecision(3)} mm`);
    updates.push(state => { lamp.update(state.near !== null); distance.element.hidden = state.near === null; distance.update(Math.log10(state.near ?? first)); });
    near.push(lamp.element, distance.element);
  }
  const light = choice("Light from", [{ name: "none", label: "Lamp" }, ...doc.environments.map(({ name, label }) => ({ name, label }))],
    environment => app.set({ environment, photograph: -1, against: false, near: null, exposure: 0 }));
  light.element.classList.add("columns");
  const turning = slider("Turned", { min: -180, max: 180, step: 1 }, value => app.set({ rotation: (value + 360) % 360 }), degrees);
  const view = roomView(app), lamp = h("div", { className: "stack" });
  updates.push(view.update, state => {
    light.update(state.environment);
    turning.update(state.rotation > 180 ? state.rotation - 360 : state.rotation);
    turning.element.hidden = state.environment === "none";
    lamp.hidden = state.environment !== "none";
  });
  lamp.append(h("div", { className: "lightbox" }, pad.element, h("div", { className: "stack" },
    number("Direction", "azimuth", 0, 360, value => app.onPainting(value), value => app.onPage(value)), number("Height", "elevation", LOWEST, 90))),
  h("div", { className: "presets" }, preset("Above", 90, 45), preset("In front", 90, 90), preset("Raking ←", 180, 10, "Raking light from the left"), preset("Raking →", 0, 10, "Raking light from the right")),
  ...near);
  return section("Light", true, light.element, view.element, turning.element, lamp, exposure.element, clipped.element, marks);
}

function colourSection(app, updates) {
  const { colours } = app.doc;
  if (!colours.adaptation) return null;
  const light = choice("Illuminant", colours.illuminants.map(one => ({ name: one.name, label: one.label })), illuminant => app.set({ illuminant }));
  const eye = check("Adapted eye", on => app.set({ adaptation: on ? colours.adaptation.mean : null }));
  const degree = slider("Degree of adaptation d", { min: 0, max: 1, step: 0.01 }, adaptation => app.set({ adaptation }), value => value.toFixed(2));
  const mean = button(colours.adaptation.mean, () => app.set({ adaptation: colours.adaptation.mean }), { className: "mark", title: "The mean of the observers of the six-band paper" });
  mean.style.setProperty("--at", colours.adaptation.mean);
  const kelvin = faint();
  degree.element.append(h("div", { className: "marks" }, mean));
  updates.push(state => {
    light.update(state.illuminant);
    eye.update(state.adaptation !== null);
    degree.element.hidden = state.adaptation === null;
    degree.update(state.adaptation ?? colours.adaptation.mean);
    const test = colours.illuminants.find(one => one.name === state.illuminant).kelvin;
    kelvin.textContent = state.adaptation === null ? `${Math.round(test)} K, shown as it is`
      : `The eye is adapted to ${Math.round(adaptedTemperature(test, colours.adaptation.reference, state.adaptation))} K; the light has ${Math.round(test)} K`;
  });
  return section("Colour of the light", true, light.element, eye.element, degree.element, kelvin);
}

function legend(app) {
  const element = h("div", { className: "legend" });
  const gradient = `linear-gradient(to right, ${app.doc.ramp.filter((_, i) => i % 17 === 0).map(c => `rgb(${c})`).join(",")})`;
  const bar = (low, high) => {
    const line = h("div", { className: "ramp" });
    line.style.background = gradient;
    return [line, h("div", { className: "ends" }, h("span", {}, low), h("span", {}, high))];
  };
  return { element, bar, update: state => {
    element.replaceChildren();
    const [low, high] = app.renderer.ranges[state.layer] ?? [0, 0];
    if (state.layer === "width") element.append(...bar(`${(2 ** low * 180 / Math.PI).toPrecision(2)}°`, `${(2 ** high * 180 / Math.PI).toPrecision(2)}°`));
    if (state.layer === "strength") element.append(...bar((2 ** low).toPrecision(2), (2 ** high).toPrecision(2)));
    if (state.layer === "height") element.append(...bar(heightWords(app.doc, low), heightWords(app.doc, high)));
    if (state.layer in QUALITY) element.append(...bar(...QUALITY[state.layer].words));
    if (state.layer === "normals") element.append(faint("Red leans right, green up, blue faces you."));
    if (state.layer === "colour") element.append(faint("The matte colours, without light and shade."));
    const { scales, read } = app.doc;
    if (read && (state.layer === "status" || state.layer in QUALITY) && scales[app.wanted()].factor > read) element.append(faint("At this scale it is not read: zoom in."));
    if (state.layer === "status") {
      element.append(h("ul", { className: "statuses" }, ...app.statuses.map(code => {
        const swatch = h("span", { className: "swatch" });
        swatch.style.background = `rgb(${app.doc.statuses[code].colour})`;
        return h("li", { title: app.doc.statuses[code].reason }, swatch, app.doc.statuses[code].name);
      })));
    }
  } };
}

function layerSection(app, updates) {
  const layers = choice("Layer", layersOf(app.doc), layer => app.set({ layer }));
  const words = legend(app);
  updates.push(state => { layers.update(state.layer); words.update(state); });
  return section("Layers", true, layers.element, words.element);
}

function effectSection(app, updates) {
  const { doc } = app;
  if (doc.basis) return section("Effects", false, faint(`${doc.basis.format}: ${doc.basis.terms} functions of the light's direction, which hold highlights, shade and shadows as they were photographed. There are no maps to switch off.`), ...doc.basis.notes.map(text => h("p", {}, `${text}.`)));
  const names = [["matte", "Matte part"], ...(doc.lobes.length ? [["gloss", "Gloss"]] : []), ...(doc.ambient ? [["ambient", "Light from all sides"]] : [])];
  const switches = names.map(([name, label]) => {
    const one = check(label, on => app.set({ [name]: on }));
    updates.push(state => one.update(state[name]));
    return one.element;
  });
  const coats = doc.colours.varnishes;
  let varnish = null;
  if (coats.length) {
    varnish = choice("Varnish", [{ name: "none", label: "As it is" }, ...coats.map(({ name, label }) => ({ name, label }))], name => app.set({ varnish: name }));
    updates.push(state => varnish.update(state.varnish));
  }
  const plan = h("div", {});
  const made = section("Effects", false, ...switches, varnish ? h("h3", {}, "Varnish") : null, varnish?.element ?? null, plan);
  // A plan of a large painting takes a second: it is made when somebody looks.
  made.addEventListener("toggle", async () => {
    const effects = await app.source.effects().catch(() => []);
    if (effects.length) plan.replaceChildren(...planned(effects));
  }, { once: true });
  return made;
}

function planned(effects) {
  const rows = effects.filter(one => one.decision !== "absent").map(one =>
    h("div", {}, h("dt", {}, one.name, h("span", { className: "tag" }, one.decision)), h("dd", {}, one.reason)));
  const absent = effects.filter(one => one.decision === "absent").map(one => one.name);
  return [h("h3", {}, "What a picture calls for"), h("dl", { className: "plan" }, ...rows),
    absent.length ? faint(`Not there: ${absent.join(", ")}.`) : ""];
}

function viewSection(app, updates) {
  const tilt = slider("Tilt", { min: 0, max: 75, step: 1 }, value => app.set({ tilt: value }), degrees);
  const towards = slider("Seen from", { min: 0, max: 359, step: 1 }, value => app.set({ towards: app.onPainting(value) }), value => `${sideOf(value)}, ${degrees(value)}`);
  const relief = slider("Relief", { min: 0, max: 10, step: 0.5 }, value => app.set({ relief: value }), value => `${value} times`);
  updates.push(state => {
    for (const [one, value] of [[tilt, state.tilt], [towards, app.onPage(state.towards)], [relief, state.relief]]) one.update(value);
    towards.element.hidden = !state.tilt;
    relief.element.hidden = !state.tilt || !app.doc.relief;
  });
  if (app.doc.basis) tilt.element.hidden = true;
  return section("View", false, tilt.element, towards.element, relief.element,
    h("div", { className: "row wrap" }, button("Show all", () => app.fit()), button("Pixel for pixel", () => app.zoomTo(1)),
      button("Turn", () => app.turn90())));
}

function compareSection(app, updates) {
  const { doc } = app, title = doc.against?.title || "The other painting";
  if (!doc.photographs.length && !doc.against) return null;
  const photographs = doc.photographs.map((one, i) => ({ name: String(i), label: `${doc.against ? "Photograph no." : "No."} ${one.number + 1}` }));
  const pick = choice("Beside it", [{ name: "-1", label: "None" }, ...(doc.against ? [{ name: "against", label: title }] : []), ...photographs],
    name => app.compareWith(name === "against" ? -1 : Number(name), name === "against"));
  const itself = h("span", {});
  const what = choice("What is shown beside it", [{ name: "photograph", label: itself }, { name: "difference", label: "Difference" }], compare => app.set({ compare }));
  const words = legend(app), scale = h("div", {}, ...words.bar("0", `${MOST_DIFFERENCE} CIEDE2000`));
  const hint = faint();
  const made = section(doc.against ? "Beside it" : "Photographs", Boolean(doc.against), pick.element, what.element, scale, hint);
  let alone = true;
  updates.push(state => {
    const picture = state.layer === "picture", none = state.photograph < 0 && !state.against;
    pick.update(state.against ? "against" : String(state.photograph));
    what.update(state.compare);
    what.element.hidden = none || !picture;
    hint.hidden = none;
    scale.hidden = none || !picture || state.compare !== "difference";
    itself.textContent = state.against ? title : "Photograph";
    const left = state.against ? doc.title || "the picture" : "the picture in the lamp of the photograph", right = state.against ? title : "the photograph";
    hint.textContent = state.against && !app.beside ? `${title} has no such layer.` : `Left of the line ${left}, right of it ${scale.hidden ? right : "the difference"}. Drag the line.`;
    // What is beside the picture says here what it is, also where a link shows it.
    if (alone && !none) unfold(made);
    alone = none;
  });
  return made;
}

function noteSection(app) {
  const list = h("ul", { className: "notes" }), hint = faint("Choose Note (N) and draw a rectangle on the painting.");
  const kept = faint();
  const open = h("input", { type: "file", accept: ".json,.jsonld,application/json", hidden: true, onchange: () => { if (open.files[0]) app.openNotes(open.files[0]); open.value = ""; } });
  app.showNotes = (notes, stored) => {
    hint.hidden = notes.length > 0;
    kept.textContent = notes.length ? (stored ? app.host.kept : "This browser keeps nothing here; save them.") : "";
    list.replaceChildren(...notes.map((one, i) => h("li", {},
      button(`${i + 1}. ${textOf(one) || "(no words)"}`, () => app.goTo(placeOf(one)), { className: "plain", title: "Show the place" }),
      button("×", () => app.removeNote(i), { className: "plain", "aria-label": `Remove note ${i + 1}` }))));
  };
  return section("Notes", false, hint, list, kept, h("div", { className: "row wrap" },
    button("Save notes", () => app.saveNotes()), button("Open notes", () => open.click()), open));
}

const KEYS = [["L, M, I, N", "light, move, inspect, note"], ["arrows", "the light, with Shift by 1°; with Inspect the place, with Shift by 10"], ["Enter", "with Note, one on the middle of what is seen"], ["R", "raking light, turned on by 45°"],
  ["+ − 0 1", "zoom, show all, pixel for pixel"], ["Shift and drag", "move"], ["wheel, two fingers", "zoom"], ["T", "turn the picture by 90°"], ["P", "copy a link to this view"], ["S", "save the picture"], ["H", "hide the panel"]];

export function panel(app) {
  const updates = [];
  const said = h("p", { className: "said", role: "status" });
  app.say = text => { said.textContent = text; };
  const element = h("aside", { "aria-label": "Controls" },
    lightSection(app, updates), colourSection(app, updates), layerSection(app, updates), effectSection(app, updates), viewSection(app, updates),
    compareSection(app, updates), pixelSection(app, updates), noteSection(app),
    section("Hand on", false, h("div", { className: "row wrap" },
      app.host.link && button("Copy link", () => app.copyLink()), button("Save PNG", () => app.savePicture()), button("Save EXR", () => app.savePicture("exr"), { title: "Linear light, for other programs" })),
    app.host.link && faint("The link holds the light, the layer and the place."), said),
    section("Keys", false, h("dl", { className: "keys" }, ...KEYS.filter(([key]) => key !== "P" || app.host.link).flatMap(([key, text]) => [h("dt", {}, key), h("dd", {}, text)]))));
  return { element, update: state => updates.forEach(update => update(state)) };
}

export const anglesFromPlane = (x, y) => {
  const across = Math.min(Math.hypot(x, y), Math.cos(LOWEST * Math.PI / 180)), scale = Math.hypot(x, y) || 1;
  return anglesOf([x / scale * across, y / scale * across, Math.sqrt(1 - across * across)]);
};
