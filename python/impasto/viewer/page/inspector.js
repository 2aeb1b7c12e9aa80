// What is known of one pixel: its numbers, its spectrum, its lobes, and what was measured there.

import { QUALITY } from "./state.js";
import { codesOf, intervalOf, labOf, spectrumOf } from "./values.js";
import { bandColour, lobePlot, samplePlot, spectrumPlot } from "./plots.js";
import { faint, h, heightWords, section, sideOf, unfold } from "./elements.js";

const KINDS = { measured: "dots are measured, rings fitted", clipped: "triangles are clipped", shadowed: "crosses in shadow" };

// Samples beside the fit, or why there are none.
function measuredParts(found) {
  const { bands, angle, measured, residual, failed } = found;
  const title = h("h3", {}, "Measured and fitted");
  if (failed) return [title, faint(failed)];
  if (angle.some(one => one === null)) {
    const values = measured.flat().filter(one => one !== null);
    return [title, faint(values.length ? `Nothing is fitted here. The ${values.length} samples go from ${Math.min(...values).toPrecision(2)} to ${Math.max(...values).toPrecision(2)}.` : "Nothing was measured here.")];
  }
  const { picture, kinds } = samplePlot(found);
  const names = bands.map((band, k) => {
    const name = h("b", {}, band);
    name.style.color = bandColour(bands, k);
    return name;
  });
  return [title, picture, faint("Light by the angle between normal and half vector: ", Object.keys(KINDS).filter(kind => kinds.has(kind)).map(kind => KINDS[kind]).join(", "), "."),
    h("p", { className: "bands" }, ...names), faint(residual === null ? "No sample is free of shadow and clipping." : `Residual ${(100 * residual).toPrecision(2)} % of the brightest, root mean square.`)];
}

export function pixelSection(app, updates) {
  const body = h("div", { "aria-live": "polite" }), taken = h("div", { className: "taken" });
  const made = section("Pixel", false, body);
  const hint = faint("Choose Inspect (I), then a place of the painting.");
  body.append(hint);
  app.showPixel = (place, values) => {
    if (!place) return body.replaceChildren(hint);
    const { doc } = app, { colours } = doc, rows = [["Place", `column ${place[0]}, row ${place[1]}`]];
    if (doc.pitch) rows.push(["", `${((place[0] + 0.5) * doc.pitch).toFixed(1)} mm from the left, ${((place[1] + 0.5) * doc.pitch).toFixed(1)} mm from the top`]);
    if (!values.relit) rows.push(["Status", values.status ? `${values.status.name}: ${values.status.reason}` : "not read"]);
    const plots = [];
    if (values.relit) {
      const under = values.relit(app.renderer.geometry(app.state).towards);
      rows.push([doc.basis.coding === "linear" ? "In this light, linear" : "In this light, coded", under.map(value => value.toFixed(3)).join(", ")]);
    } else if (values.shown) {
      rows.push(["Normal", `tilted ${(90 - values.elevation).toFixed(1)}° towards light from ${sideOf(app.onPage(values.azimuth))}`]);
      for (const name of doc.quality) rows.push([QUALITY[name].label, values.quality[name] < 0 ? "not known" : QUALITY[name].shown(values.quality[name])]);
      if (values.height !== null) rows.push(["Height", heightWords(doc, values.height)]);
      if (colours.basis) {
        const lab = labOf(colours, app.state.illuminant, values.diffuse);
        rows.push(["Lab", lab.map(value => value.toFixed(1)).join(", ")]);
        const spectrum = spectrumOf(colours, values.diffuse), half = intervalOf(colours, spectrum);
        plots.push(h("h3", {}, "Reflectance"), spectrumPlot(colours.wavelengths, spectrum, half), half ? faint("The band holds 95 % of the errors on training spectra.") : "");
      } else {
        rows.push(["Colour", values.diffuse.map((value, k) => `${doc.bands[k] ?? k + 1} ${value.toFixed(3)}`).join(", ")]);
      }
      const codes = codesOf(app.renderer.colours.diffuse, values.diffuse);
      rows.push(["sRGB in full light", codes.join(", ")]);
      values.lobes.forEach((lobe, i) => {
        const shape = doc.model === "lafortune" ? lobe.shape.map((value, k) => `${["Cxy", "Cz", "n"][k]} ${value.toPrecision(3)}`).join(", ")
          : `half-width ${(lobe.shape[0] * 180 / Math.PI).toPrecision(3)}°`;
        rows.push([values.lobes.length > 1 ? `Lobe ${i + 1}` : "Gloss", `${shape}, strength ${lobe.strength.map(value => value.toPrecision(3)).join(", ")}`]);
      });
      const luminance = values => {
        const row = colours.illuminants[0].diffuse[1];
        return values.reduce((sum, value, k) => sum + row[k] * value, 0);
      };
      plots.push(h("h3", {}, "Reflected light"), lobePlot(doc, values, luminance));
    }
    // Those of the place before stay until the new ones are there: nothing jumps while the hand moves.
    taken.classList.toggle("stale", doc.samples);
    if (!doc.samples) taken.replaceChildren(...(values.shown && !values.relit ? [faint("What the photographs measured here is shown by ", h("code", {}, "impasto view"), " with ", h("code", {}, "--photographs"), ", or in a notebook with ", h("code", {}, "stack="), ".")] : []));
    body.replaceChildren(h("dl", { className: "values" }, ...rows.flatMap(([name, text]) => [h("dt", {}, name), h("dd", {}, text)])), ...plots, taken);
    unfold(made);
  };
  app.showSamples = found => {
    taken.classList.remove("stale");
    taken.replaceChildren(...measuredParts(found));
  };
  return made;
}
