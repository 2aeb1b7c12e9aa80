// What shows a painting: a page of its own. It keeps the state behind # in its address, and notes in the browser.

import { storeAnnotations, storedAnnotations } from "./annotations.js";

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
