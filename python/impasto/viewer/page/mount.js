// A painting in an element of a page, a notebook, or whatever else shows it.

import { h } from "./elements.js";
import { Viewer } from "./viewer.js";

// Show a painting in an element. `source` gives tiles by name and photographs by number, as promises; `host` keeps
// state and notes, as those of host.js.
export function mount(element, doc, source, host) {
  try {
    return new Viewer(element, doc, source, host);
  } catch (error) {
    element.replaceChildren(h("p", { className: "refused", role: "alert" }, error.message));
    throw error;
  }
}
