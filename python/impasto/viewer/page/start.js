// Where a page begins: a painting in an element of a site, or of whatever else shows it.

import { scriptSource } from "./tiles.js";
import { h } from "./elements.js";
import { pageHost } from "./host.js";
import { Viewer } from "./viewer.js";

// Show a painting in an element. `source` gives tiles by name and photographs by number, as promises; `host` keeps
// state and notes, as those of host.js.
export function mount(element, doc, source, host = pageHost(doc)) {
  try {
    return new Viewer(element, doc, source, host);
  } catch (error) {
    element.replaceChildren(h("p", { className: "refused", role: "alert" }, error.message));
    throw error;
  }
}

// The page of a site.
export function startPage() {
  const { document: doc } = window.impasto;
  window.impasto.viewer = mount(window.document.getElementById("impasto"), doc, scriptSource(""));
}
