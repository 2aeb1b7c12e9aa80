// What shows a painting: a page of its own. It keeps the state behind # in its address, and notes in the browser. Its files
// are fetched as scripts, which also works from a disk.

import { filesOf } from "./tiles.js";
import { annotationsOf } from "./annotations.js";

const key = doc => `impasto notes ${doc.title} ${doc.width}x${doc.height}`;

// A page that is opened from a disk may have no storage.
function storedAnnotations(doc) {
  try {
    return annotationsOf(JSON.parse(localStorage.getItem(key(doc)) ?? "[]"), doc);
  } catch {
    return [];
  }
}

function storeAnnotations(doc, list) {
  try {
    localStorage.setItem(key(doc), JSON.stringify(list));
    return true;
  } catch {
    return false;
  }
}

// Each script calls window.impasto.arrived(name, data) with base64: of gzip for a tile, of PNG for a photograph.
export function scriptSource(folder) {
  const waiting = new Map();
  window.impasto.arrived = (name, data) => waiting.get(name)?.(data);
  const load = name => new Promise((resolve, reject) => {
    const element = document.createElement("script");
    const done = (settle, value) => {
      waiting.delete(name);
      element.remove();
      settle(value);
    };
    waiting.set(name, data => done(resolve, data));
    element.onload = () => waiting.has(name) && done(reject, new Error(`${name} holds nothing`));
    element.onerror = () => done(reject, new Error(`${name} is missing`));
    element.src = `${folder}${name}.js`;
    document.head.append(element);
  }).then(bytesOf);
  return filesOf(load);
}

function bytesOf(data) {
  const text = atob(data), bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
  return bytes;
}

export function pageHost(doc) {
  let linked = null;
  return {
    title: text => { document.title = text; },
    // The state as text, and whoever wants to know when it changes from outside.
    read: () => location.hash,
    write: text => {
      linked = `#${text}`;
      try {
        history.replaceState(null, "", linked);
      } catch {
        // A page in a frame may have no address of its own.
      }
    },
    changed: tell => window.addEventListener("hashchange", () => { if (location.hash !== linked) tell(); }),
    // The address that shows the same again.
    link: text => `${location.href.split("#")[0]}#${text}`,
    // What notes are about. The address on this machine alone holds a token, which is not to be handed on.
    source: () => (["127.0.0.1", "localhost"].includes(location.hostname) ? "urn:impasto:view" : location.href.split("#")[0]),
    notes: () => storedAnnotations(doc),
    keepNotes: list => storeAnnotations(doc, list),
    // Keys are meant for the painting wherever the focus is.
    keys: document,
    kept: "Kept in this browser; save them to hand them on.",
    // What is shown: something, and all that the view needs.
    shown: complete => {
      const { dataset } = document.documentElement;
      dataset.shown ??= String(Math.round(performance.now()));
      if (complete) dataset.ready = "true";
      else delete dataset.ready;
    },
  };
}
