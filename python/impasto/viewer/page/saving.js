// What leaves the page: pictures and files; and the dialog of a note.

import { h } from "./elements.js";

// A picture turned as on the page.
export async function upright(data, turns) {
  const across = turns % 2 === 1;
  const canvas = h("canvas", { width: across ? data.height : data.width, height: across ? data.width : data.height });
  const context = canvas.getContext("2d");
  if (!turns) context.putImageData(data, 0, 0);
  else {
    context.translate(canvas.width / 2, canvas.height / 2);
    context.rotate(-turns * Math.PI / 2);
    context.imageSmoothingEnabled = false;
    context.drawImage(await createImageBitmap(data), -data.width / 2, -data.height / 2);
  }
  return canvas;
}

export function download(blob, name) {
  const address = URL.createObjectURL(blob), anchor = h("a", { href: address, download: name });
  anchor.click();
  setTimeout(() => URL.revokeObjectURL(address), 10000);
}

// Asks for the words of a note; calls back with them, or with nothing.
export function noteDialog(done) {
  const text = h("textarea", { rows: 3, "aria-label": "Note" });
  const dialog = h("dialog", { className: "ask", onclose: () => {
    dialog.remove();
    done(dialog.returnValue === "keep" ? text.value.trim() : "");
  } }, h("form", { method: "dialog" }, h("h2", {}, "Note"), text, h("div", { className: "row" },
    h("button", { value: "keep", className: "main" }, "Keep"), h("button", { value: "" }, "Cancel"))));
  return dialog;
}
