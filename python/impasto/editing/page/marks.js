// Marks of photographs: the file of impasto align --points.

import {
  byId, view, doc, shown, change, reveal, refresh, screen, place, cross, label, CHOSEN, OTHER,
  fields, list, rebuild, tell, note, fixed, rounded, distance, button, element, keys,
} from "./editor.js";

const brief = (name) => name.replace(/^(marker \d+, .*) corner$/, "$1");

export function marksSubject() {
  let chosen = 0;
  const self = {
    state: { points_mm: doc.points_mm, points: doc.points },
    content: () => ({
      size_mm: doc.size_mm, points_mm: self.state.points_mm, kind: doc.mark_kind, search_px: doc.search_px,
      photographs: self.state.points,
    }),
    names: () => Object.keys(self.state.points_mm),
    owner: (n = shown) => (doc.photographs[n].name in self.state.points ? doc.photographs[n].name : "default"),
    own: () => self.state.points[self.owner()] ?? {},
    place: () => self.own()[self.names()[chosen]],
    said: (n) => {
      const owner = self.owner(n);
      if (!(owner in self.state.points)) return "no marks";
      return doc.notes[doc.photographs[n].name] ? "check" : owner === "default" ? "" : "own marks";
    },
    restored: () => { chosen = Math.min(chosen, self.names().length - 1); },
    move: (name, [x, y]) => { self.own()[name] = [rounded(x), rounded(y)]; },
    over: (point, reach) => {
      const all = Object.entries(self.own()).map(([name, place]) => [distance(point, place), name]).sort((a, b) => a[0] - b[0]);
      return all.length && all[0][0] <= reach ? all[0][1] : null;
    },
    grab: (point, reach) => {
      const name = self.over(point, reach);
      if (!name) return null;
      chosen = self.names().indexOf(name);
      return (now, by) => self.move(name, [self.own()[name][0] + by[0], self.own()[name][1] + by[1]]);
    },
    next: (by) => {
      const count = self.names().length;
      chosen = (chosen + by + count) % count;
      reveal();
      refresh();
    },
    arrow: ([x, y], step) => {
      const before = self.place();
      if (before) change(`move ${shown} ${chosen}`, () => self.move(self.names()[chosen], [before[0] + step * x, before[1] + step * y]));
      reveal();
    },
    paint: (context, from, fine) => {
      const own = self.own(), name = self.names()[chosen];
      if (!fine) {
        const corners = ["upper left", "upper right", "lower right", "lower left"].map((one) => own[one]);
        if (corners.every(Boolean)) {
          context.strokeStyle = "rgba(127,224,232,.55)";
          context.lineWidth = 1;
          context.beginPath();
          corners.forEach((corner) => context.lineTo(...screen(corner, from)));
          context.closePath();
          context.stroke();
        }
      }
      for (const [one, point] of Object.entries(own)) {
        if (fine && one !== name) continue;
        cross(context, screen(point, from), one === name, one === name ? CHOSEN : OTHER, fine);
      }
      const few = Object.keys(own).length <= 8;
      if (!fine) for (const [one, point] of Object.entries(own)) if (few || one === name) label(context, brief(one), screen(point, from));
    },
    panel: () => {
      const names = self.names(), name = names[chosen], point = self.place();
      byId("title").textContent = "Marks";
      byId("name").textContent = name;
      view.setAttribute("aria-label", `${doc.photographs[shown].name}: marks`);
      fields(point ? [
        ["column", point[0].toFixed(2), 0.1, (x) => change("column", () => self.move(name, [x, self.place()[1]]))],
        ["row", point[1].toFixed(2), 0.1, (y) => change("row", () => self.move(name, [self.place()[0], y]))],
      ] : []);
      const own = self.own();
      list(byId("list"), "Marks", names.map((one) => [brief(one), own[one] ? `${fixed(own[one][0], 1)}, ${fixed(own[one][1], 1)}` : "not here"]),
        chosen, (n) => { chosen = n; reveal(); refresh(); });
      self.tools(name, point);
      if (point) tell(`${name}: column ${fixed(point[0])}, row ${fixed(point[1])}`);
    },
    tools: (name, point) => {
      const photograph = doc.photographs[shown].name, owner = self.owner(), points = self.state.points;
      const many = Object.keys(self.own()).length > 4;
      const key = JSON.stringify([shown, name, owner, Boolean(point), many, Object.keys(points)]);
      rebuild(byId("tools"), key, () => {
        const made = [], said = doc.notes[photograph] ?? doc.notes.default;
        if (said) made.push(note(said));
        if (!(owner in points)) {
          const other = Object.keys(points)[0];
          made.push(button(`Begin with the marks of ${other}`, () => change("begin", () => { points[photograph] = structuredClone(points[other]); })));
          return made;
        }
        const box = element("input", { type: "checkbox", checked: owner !== "default", onchange: () => change("own", () => {
          if (box.checked) self.state.points[photograph] = structuredClone(self.own());
          else delete self.state.points[photograph];
        }) });
        // Without marks for all, a photograph needs its own.
        box.disabled = owner !== "default" && !points.default;
        if (doc.photographs.length > 1) made.push(
          element("label", { className: "check" }, box, "This photograph has marks of its own"),
          button("Copy to all after it", () => change("copy", () => {
            for (const one of doc.photographs.slice(shown + 1)) self.state.points[one.name] = structuredClone(self.own());
          }), { disabled: shown + 1 >= doc.photographs.length }));
        if (!point) made.push(button("Place it here", () => change("place", () => self.move(name, place(view.clientWidth / 2, view.clientHeight / 2)))));
        else if (many) made.push(button("Remove it here", () => change("remove", () => { delete self.own()[name]; })));
        made.push(self.adding ??= self.form());
        return made;
      });
    },
    form: () => {
      const input = (text, type) => element("label", { textContent: text }, element("input", { type, step: "any" }));
      const inputs = [input("name", "text"), input("x, mm from the middle to the right", "number"), input("y, mm from the middle up", "number")];
      return element("details", {}, element("summary", { textContent: "Add a mark" }), ...inputs, button("Add", () => {
        const [name, x, y] = inputs.map((one) => one.querySelector("input"));
        const called = name.value.trim();
        if (!called || called in self.state.points_mm || !Number.isFinite(x.valueAsNumber + y.valueAsNumber)) return name.focus();
        change("add", () => {
          self.state.points_mm[called] = [x.valueAsNumber, y.valueAsNumber];
          self.move(called, place(view.clientWidth / 2, view.clientHeight / 2));
          chosen = self.names().length - 1;
        });
        name.value = "";
        view.focus();
      }));
    },
  };
  keys([["Arrows", "0.1 pixels"], ["Shift arrows", "1 pixel"]]);
  return self;
}
