// Outlines of mirror balls: the files of impasto calibrate lights --circles.

import {
  byId, view, doc, shown, change, reveal, refresh, screen, place, size, cross, label, CHOSEN,
  OTHER, fields, list, rebuild, tell, note, fixed, rounded, distance, button, element, keys,
} from "./editor.js";

/** Middle and radius of the circle through three points; null if they lie on a line. */
function circleThrough([a, b, c]) {
  const [bx, by, cx, cy] = [b[0] - a[0], b[1] - a[1], c[0] - a[0], c[1] - a[1]];
  const turn = 2 * (bx * cy - by * cx);
  if (Math.abs(turn) < 1e-6) return null;
  const x = (cy * (bx * bx + by * by) - by * (cx * cx + cy * cy)) / turn;
  const y = (bx * (cx * cx + cy * cy) - cx * (bx * bx + by * by)) / turn;
  return [a[0] + x, a[1] + y, Math.hypot(x, y)];
}

export function ballsSubject() {
  const handles = ([x, y, r]) => [-90, 30, 150].map((turn) => [x + r * Math.cos(turn * Math.PI / 180), y + r * Math.sin(turn * Math.PI / 180)]);
  const HANDLES = ["upper edge", "right edge", "left edge"];
  let ball = 0, handle = 0; // handle 3 is the middle
  const self = {
    state: { sets: doc.sets.map((one) => one.circles.map(handles)) },
    content: () => ({ sets: self.state.sets.map((one) => one.map((points) => circleThrough(points).map(rounded))) }),
    number: () => doc.photographs[shown].set,
    own: () => self.state.sets[self.number()],
    places: (points) => [...points, circleThrough(points).slice(0, 2)],
    place: () => self.own()[ball] && self.places(self.own()[ball])[handle],
    shown: () => { ball = Math.min(ball, self.own().length - 1); },
    restored: () => self.shown(),
    said: (n) => (doc.sets.length > 1 ? doc.sets[doc.photographs[n].set].name : ""),
    over: (point, reach) => {
      const all = self.own().flatMap((points, b) => self.places(points).map((one, h) => [distance(point, one), b, h])).sort((p, q) => p[0] - q[0]);
      return all.length && all[0][0] <= reach ? all[0].slice(1) : null;
    },
    moved: ([dx, dy]) => {
      const points = structuredClone(self.own()[ball]);
      for (const n of handle === 3 ? [0, 1, 2] : [handle]) points[n] = [points[n][0] + dx, points[n][1] + dy];
      const circle = circleThrough(points);
      // Handles on a line make no circle.
      if (circle && circle[2] < 20 * Math.max(size().columns, size().rows)) self.own()[ball] = points;
    },
    grab: (point, reach) => {
      const found = self.over(point, reach);
      if (!found) return null;
      [ball, handle] = found;
      return (now, by) => self.moved(by);
    },
    next: (by) => {
      const count = 4 * self.own().length, now = (4 * ball + handle + by + count) % count;
      [ball, handle] = [Math.floor(now / 4), now % 4];
      reveal();
      refresh();
    },
    arrow: ([x, y], step) => {
      change(`move ${shown} ${ball} ${handle}`, () => self.moved([step * x, step * y]));
      reveal();
    },
    paint: (context, from, fine) => {
      self.own().forEach((points, b) => {
        const [x, y, r] = circleThrough(points), [sx, sy] = screen([x, y], from);
        for (const [stroke, width] of [["rgba(0,0,0,.7)", 3], [b === ball ? CHOSEN : OTHER, 1.4]]) {
          context.strokeStyle = stroke;
          context.lineWidth = fine ? width * 0.7 : width;
          context.beginPath();
          context.arc(sx, sy, r * from.scale, 0, 2 * Math.PI);
          context.stroke();
        }
        if (fine) return;
        points.forEach((point, h) => {
          context.beginPath();
          context.arc(...screen(point, from), b === ball && h === handle ? 7 : 5, 0, 2 * Math.PI);
          context.fillStyle = b === ball && h === handle ? CHOSEN : "#fff";
          context.strokeStyle = "rgba(0,0,0,.8)";
          context.lineWidth = 1.5;
          context.fill();
          context.stroke();
        });
        cross(context, [sx, sy], b === ball && handle === 3, b === ball && handle === 3 ? CHOSEN : OTHER);
        if (self.own().length > 1) label(context, `ball ${b + 1}`, [sx, sy]);
      });
    },
    panel: () => {
      const points = self.own()[ball], [x, y, r] = circleThrough(points);
      const set = ([nx, ny, nr]) => change("circle", () => { if (nr > 0) self.own()[ball] = handles([nx, ny, nr]); });
      const called = self.own().length > 1 ? `ball ${ball + 1}` : doc.sets[self.number()].name;
      byId("title").textContent = "Mirror balls";
      byId("name").textContent = `${called}, ${HANDLES[handle] ?? "middle"}`;
      view.setAttribute("aria-label", `${doc.photographs[shown].name}: outlines of mirror balls`);
      const plain = (number) => number.toFixed(2);
      fields([["column", plain(x), 0.1, (v) => set([v, y, r])], ["row", plain(y), 0.1, (v) => set([x, v, r])], ["radius", plain(r), 0.1, (v) => set([x, y, v])]]);
      list(byId("list"), "Outlines", self.own().map((one, b) => {
        const [cx, cy, cr] = circleThrough(one);
        return [self.own().length > 1 ? `ball ${b + 1}` : called, `${fixed(cx, 1)}, ${fixed(cy, 1)} · ${fixed(cr, 1)}`];
      }), ball, (n) => { ball = n; handle = 0; reveal(); refresh(); });
      rebuild(byId("tools"), JSON.stringify([self.number(), self.own().length]), () => {
        const made = [], said = doc.notes[doc.sets[self.number()].name];
        if (said) made.push(note(said));
        if (doc.alone) return made;
        const add = () => change("add", () => {
          const [cx, cy] = place(view.clientWidth / 2, view.clientHeight / 2);
          self.own().push(handles([cx, cy, circleThrough(self.own()[0])[2]]));
          ball = self.own().length - 1;
        });
        const remove = () => change("remove", () => { self.own().splice(ball, 1); self.shown(); });
        return [...made, element("div", { className: "row" }, button("Add", add),
          button("Remove", remove, { disabled: self.own().length < 2 }))];
      });
      tell(`${byId("name").textContent}: middle ${fixed(x)}, ${fixed(y)}, radius ${fixed(r)}`);
    },
  };
  keys([["Arrows", "0.1 pixels"], ["Shift arrows", "1 pixel"]]);
  return self;
}
