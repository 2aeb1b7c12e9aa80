// The page of a site.

import { mount } from "./mount.js";
import { pageHost, scriptSource } from "./host.js";

export function startPage() {
  const { document: doc } = window.impasto;
  window.impasto.viewer = mount(window.document.getElementById("impasto"), doc, scriptSource(""), pageHost(doc));
}
