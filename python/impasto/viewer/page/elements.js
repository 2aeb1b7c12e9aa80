// Elements of the page: how they are made, and the controls of the panel.

export function h(name, attributes = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (key.startsWith("on")) made.addEventListener(key.slice(2), value);
    else if (key in made && key !== "list" && key !== "form") made[key] = value;
    else if (value !== null) made.setAttribute(key, value);
  }
  made.append(...children.filter(child => child !== null));
  return made;
}

// Nobody else acts upon an event.
export const taken = event => {
  event.preventDefault();
  event.stopPropagation();
};

export const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }; // right and up

export const button = (text, onclick, more) => h("button", { type: "button", onclick, ...more }, text);

export const faint = (...text) => h("p", { className: "faint" }, ...text);

const SIDES = ["the right", "the upper right", "above", "the upper left", "the left", "the lower left", "below", "the lower right"];
export const sideOf = azimuth => SIDES[Math.round(azimuth / 45) % 8];

export const degrees = value => `${Math.round(value)}°`;

export const heightWords = (doc, value) => `${value.toPrecision(3)} ${doc.pitch ? "mm" : "pixels"}`;

let serial = 0;
export function slider(text, attributes, change, shown) {
  const id = `impasto-${++serial}`, output = h("output", { htmlFor: id });
  const input = h("input", { type: "range", id, ...attributes, oninput: () => change(Number(input.value)) });
  const element = h("div", { className: "field" }, h("label", { htmlFor: id }, text), output, input);
  return { element, input, update: value => {
    if (input.getRootNode().activeElement !== input || Number(input.value) !== value) input.value = value;
    output.textContent = shown(value);
    input.setAttribute("aria-valuetext", shown(value));
  } };
}

export function choice(name, options, change) {
  const group = `impasto-${++serial}`;
  const inputs = options.map(option => h("input", { type: "radio", name: group, value: option.name, onchange: () => change(option.name) }));
  const element = h("div", { className: "choice", role: "radiogroup", "aria-label": name },
    ...options.map((option, i) => h("label", {}, inputs[i], h("span", {}, option.label))));
  return { element, update: value => inputs.forEach(input => { input.checked = input.value === value; }) };
}

export function check(text, change) {
  const input = h("input", { type: "checkbox", onchange: () => change(input.checked) });
  return { element: h("label", { className: "check" }, input, h("span", {}, text)), update: value => { input.checked = value; } };
}

export const section = (title, open, ...children) => h("details", { open }, h("summary", {}, h("h2", {}, title)), h("div", { className: "body" }, ...children));

// Opens a section where it is seen.
export function unfold(made) {
  made.open = true;
  made.scrollIntoView({ block: "nearest" });
}
