// A painting in the output of a notebook, as anywidget (https://anywidget.dev) asks for it: tiles come from the model, or by its messages.

import { filesOf } from "./tiles.js";
import { h } from "./elements.js";
import { mount } from "./mount.js";

const PATIENCE = 8000; // ms until a reader is told why nothing is seen

const bytesOfView = view => new Uint8Array(view.buffer, view.byteOffset, view.byteLength);

// Files by name: those that the model holds, others from Python.
function modelSource(model) {
  const waiting = new Map(); // name: promise with its ends
  const answer = ({ file: name, refused }, buffers) => {
    const asked = waiting.get(name);
    if (!asked) return;
    waiting.delete(name);
    if (refused) asked.reject(new Error(refused));
    else asked.resolve(bytesOfView(buffers[0]));
  };
  model.on("msg:custom", answer);
  const load = name => {
    const kept = model.get("files")[name];
    if (kept) return Promise.resolve(bytesOfView(kept));
    if (!waiting.has(name)) {
      const asked = {};
      asked.promise = new Promise((resolve, reject) => Object.assign(asked, { resolve, reject }));
      waiting.set(name, asked);
      model.send({ file: name });
    }
    return waiting.get(name).promise;
  };
  return {
    ...filesOf(load),
    close: () => model.off("msg:custom", answer),
  };
}

// The state and the notes are the model's, so Python reads and sets them, and views of one model agree.
function modelHost(model, root) {
  let own = model.get("state"), told = null;
  const tell = () => { if (model.get("state") !== own) told?.(); };
  const put = (name, value) => {
    model.set(name, value);
    model.save_changes();
  };
  model.on("change:state", tell);
  return {
    title: () => {},
    read: () => (own = model.get("state")),
    write: text => {
      if (text !== model.get("state")) put("state", own = text);
    },
    changed: call => { told = call; },
    link: null,
    source: () => "notebook",
    notes: () => [...model.get("notes")],
    keepNotes: list => {
      put("notes", [...list]);
      return true;
    },
    kept: "Kept by the notebook; save them to hand them on.",
    shown: complete => root.host.toggleAttribute("data-ready", complete),
    close: () => model.off("change:state", tell),
  };
}

// Light or dark as the notebook, which need not be as the system; null: not known.
function themeOf() {
  const { jpThemeLight, vscodeThemeKind } = document.body.dataset;
  if (jpThemeLight) return jpThemeLight === "true" ? "light" : "dark";
  if (vscodeThemeKind) return /light/.test(vscodeThemeKind) ? "light" : "dark";
  return null;
}

export function renderNotebook({ model, el }) {
  // In a tree of its own: neither the notebook's style nor this one reaches the other.
  const box = h("div", {}), root = box.attachShadow({ mode: "open" });
  box.style.height = `${model.get("height_px")}px`;
  // Keys and the menu of the right button are the painting's here.
  box.dataset.lmSuppressShortcuts = "true";
  box.dataset.jpSuppressContextMenu = "true";
  const follow = () => { box.style.colorScheme = themeOf() ?? ""; };
  const theme = new MutationObserver(follow);
  theme.observe(document.body, { attributes: true });
  follow();
  const element = h("div", { className: "impasto" });
  root.append(h("style", {}, STYLE), element);
  el.append(box);
  const source = modelSource(model), host = modelHost(model, root);
  const viewer = mount(element, JSON.parse(model.get("document")), source, host);
  const late = setTimeout(() => { viewer.wait.textContent = "Waiting for Python. If the kernel was restarted, run the cell again."; }, PATIENCE);
  box.viewer = viewer;
  return () => {
    clearTimeout(late);
    theme.disconnect();
    source.close();
    host.close();
    viewer.close();
  };
}
