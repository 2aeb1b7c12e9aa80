// Heights of a depth mesh: the file of impasto align --depth.

import {
  byId, view, FINE, doc, change, reveal, refresh, screen, size, CHOSEN, fields, tell,
  fixed, button, element, keys, draw,
} from "./editor.js";

export function meshSubject() {
  const rows = doc.depth_mm.length, columns = doc.depth_mm[0].length;
  const small = element("canvas", { width: columns, height: rows });
  const STEPS = [0.01, 0.1]; // mm of a key, and with Shift
  let row = rows >> 1, column = columns >> 1, tool = "choose", reach = 2, strong = 0.8;
  const across = 1200 / Math.max(...doc.size_mm);
  const self = {
    state: { depth: doc.depth_mm },
    size: { columns: doc.size_mm[0] * across, rows: doc.size_mm[1] * across },
    content: () => ({ depth_mm: self.state.depth }),
    node: (r, c) => [c / (columns - 1) * size().columns - 0.5, r / (rows - 1) * size().rows - 0.5],
    place: () => self.node(row, column),
    found: ([x, y]) => [
      Math.max(0, Math.min(rows - 1, (y + 0.5) / size().rows * (rows - 1))),
      Math.max(0, Math.min(columns - 1, (x + 0.5) / size().columns * (columns - 1))),
    ],
    range: () => {
      const all = self.state.depth.flat(), low = Math.min(...all), high = Math.max(...all);
      return [low, high > low ? high : low + 1e-6];
    },
    /** Each node within the brush becomes more like the mean of its neighbours. */
    smooth: (at) => {
      const [r0, c0] = self.found(at), before = structuredClone(self.state.depth);
      const height = (r, c) => before[Math.max(0, Math.min(rows - 1, r))][Math.max(0, Math.min(columns - 1, c))];
      for (let r = Math.ceil(Math.max(0, r0 - reach)); r <= Math.min(rows - 1, r0 + reach); r++)
        for (let c = Math.ceil(Math.max(0, c0 - reach)); c <= Math.min(columns - 1, c0 + reach); c++) {
          const away = Math.hypot(r - r0, c - c0) / reach;
          if (away > 1) continue;
          const mean = (height(r - 1, c) + height(r + 1, c) + height(r, c - 1) + height(r, c + 1)) / 4;
          const weight = 0.35 * (1 - away * away);
          self.state.depth[r][c] = Math.round(1e4 * (before[r][c] + weight * (mean - before[r][c]))) / 1e4;
        }
    },
    grab: (point) => {
      const [r, c] = self.found(point);
      if (tool === "smooth") {
        change("drag", () => self.smooth(point)); // what follows is undone with it
        return (now) => self.smooth(now);
      }
      const [x, y] = point;
      if (x < -0.5 || y < -0.5 || x > size().columns || y > size().rows) return null;
      [row, column] = [Math.round(r), Math.round(c)];
      return null;
    },
    raise: (mm) => change(`raise ${row} ${column}`, () => {
      self.state.depth[row][column] = Math.round(1e4 * (self.state.depth[row][column] + mm)) / 1e4;
    }),
    next: (by) => {
      const now = (row * columns + column + by + rows * columns) % (rows * columns);
      [row, column] = [Math.floor(now / columns), now % columns];
      reveal();
      refresh();
    },
    arrow: ([x, y], step) => {
      const by = step === FINE ? 1 : 5;
      row = Math.max(0, Math.min(rows - 1, row + by * y));
      column = Math.max(0, Math.min(columns - 1, column + by * x));
      reveal();
      refresh();
    },
    key: (event) => {
      const step = STEPS[event.shiftKey ? 1 : 0];
      if (event.key === "PageUp") self.raise(step);
      else if (event.key === "PageDown") self.raise(-step);
      else if (event.key === "b" || event.key === "B") { tool = tool === "smooth" ? "choose" : "smooth"; refresh(); }
      else return false;
      return true;
    },
    below: (context) => {
      const [low, high] = self.range(), data = new ImageData(columns, rows);
      self.state.depth.flat().forEach((height, n) => {
        data.data.set([...doc.ramp[Math.round(255 * (height - low) / (high - low))], 255], 4 * n);
      });
      small.getContext("2d").putImageData(data, 0, 0);
      const [w, h] = [size().columns, size().rows], [dx, dy] = [w / (columns - 1), h / (rows - 1)];
      context.save();
      context.beginPath();
      context.rect(-0.5, -0.5, w, h);
      context.clip();
      context.globalAlpha = doc.photographs.length ? strong : 1;
      context.imageSmoothingEnabled = true;
      // The middles of the small canvas's pixels come to lie on the nodes.
      context.drawImage(small, -0.5 - dx / 2, -0.5 - dy / 2, w + dx, h + dy);
      context.restore();
    },
    paint: (context, from) => {
      const apart = size().columns / (columns - 1) * from.scale;
      context.fillStyle = "rgba(255,255,255,.55)";
      if (apart > 7) for (let r = 0; r < rows; r++) for (let c = 0; c < columns; c++) {
        const [x, y] = screen(self.node(r, c), from);
        context.fillRect(x - 1, y - 1, 2, 2);
      }
      const [x, y] = screen(self.place(), from);
      for (const [stroke, width] of [["rgba(0,0,0,.8)", 4], [CHOSEN, 2]]) {
        context.strokeStyle = stroke;
        context.lineWidth = width;
        context.beginPath();
        context.arc(x, y, 7, 0, 2 * Math.PI);
        context.stroke();
      }
    },
    panel: () => {
      const height = self.state.depth[row][column], [w, h] = doc.size_mm, [low, high] = self.range();
      const x = (column / (columns - 1) - 0.5) * w, y = (0.5 - row / (rows - 1)) * h;
      byId("title").textContent = "Depth mesh";
      byId("name").textContent = `Node at ${fixed(x, 1)}, ${fixed(y, 1)} mm`;
      view.setAttribute("aria-label", "Heights of the painting");
      fields([["height, mm", height.toFixed(4), 0.01, (mm) => change("height", () => { self.state.depth[row][column] = Math.round(1e4 * mm) / 1e4; })]]);
      const section = byId("list");
      if (!section.children.length) self.build(section);
      self.text[0].textContent = `${fixed(low)} mm`;
      self.text[1].textContent = `${fixed(high)} mm`;
      self.tool.forEach((one) => { one.checked = one.value === tool; });
      tell(`${byId("name").textContent}: height ${fixed(height, 3)} mm`);
    },
    build: (section) => {
      const ramp = element("canvas", { className: "ramp", width: 256, height: 1 });
      ramp.setAttribute("aria-hidden", "true");
      const data = new ImageData(256, 1);
      doc.ramp.forEach((rgb, n) => data.data.set([...rgb, 255], 4 * n));
      ramp.getContext("2d").putImageData(data, 0, 0);
      self.text = [element("span"), element("span")];
      const radio = (value) => element("input", { type: "radio", name: "tool", value, onchange: () => { tool = value; view.focus(); refresh(); } });
      self.tool = [radio("choose"), radio("smooth")];
      const slider = (name, min, max, step, value, set) => element("label", { textContent: name },
        element("input", { type: "range", min, max, step, value, oninput: (event) => { set(event.target.valueAsNumber); draw(); } }));
      section.className = "stack";
      section.append(
        element("h2", { textContent: "Height above the plane of the marks" }), ramp,
        element("div", { className: "scale" }, ...self.text),
        element("div", { className: "row" }, button("Higher", () => self.raise(STEPS[0])), button("Lower", () => self.raise(-STEPS[0]))),
        element("label", { className: "check" }, self.tool[0], "Choose a node"),
        element("label", { className: "check" }, self.tool[1], "Smooth with a brush"),
        slider("radius of the brush, nodes", 1, 8, 0.5, reach, (value) => { reach = value; }));
      if (doc.photographs.length) section.append(slider("colours over the photograph", 0, 1, 0.05, strong, (value) => { strong = value; }));
    },
  };
  keys([["Arrows", "another node"], ["Page Up, Down", "0.01 mm, with Shift 0.1"], ["B", "brush"]]);
  return self;
}
