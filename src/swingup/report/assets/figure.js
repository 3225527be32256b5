/*
 * Draws a figure from its description (report/figure.py) in SVG: panels with axes, a legend that hides curves, zoom, the
 * values under the pointer, and a cursor in time. Colours are the style sheet's variables, and names are text, never markup.
 */
(function (swingup) {
  "use strict";

  const MARGIN = { left: 58, right: 14, top: 8, bottom: 40 }; // around a plot (pixels)
  const HEIGHT = { shared: 142, alone: 290 }; // of a plot (pixels)
  const STYLES = {
    line: { width: 2.2 }, thin: { width: 1.1, opacity: 0.8 }, dashed: { width: 1.6, dash: "5 4" },
    dots: { radius: 2.5, opacity: 0.55 }, ring: { radius: 5 }, star: { radius: 3 },
    bars: { opacity: 1 }, "pale bars": { opacity: 0.45 },
  };
  const LEAST_DRAG = 6; // pixels; a shorter one is a click
  const GROUPS = 8; // colours of series in the style sheet
  const DASHES = ["none", "9 4", "2 3"];

  const colourOf = (colour) => `var(--${typeof colour === "number" ? `series-${colour % GROUPS}` : colour})`;
  /** Of series beyond the last colour, which begin with the first again. */
  const dashOf = (colour) => (typeof colour === "number" ? DASHES[Math.floor(colour / GROUPS) % DASHES.length] : "none");
  const number = (value, digits) => value.toFixed(digits).replace("-", "\u2212");

  let stored = null;
  const decoded = new Map();

  /** An array of the page's data by its place. */
  function array(place) {
    stored = stored || JSON.parse(document.getElementById("data").textContent);
    if (!decoded.has(place)) {
      const bytes = Uint8Array.from(atob(stored.arrays[place]), (letter) => letter.charCodeAt(0));
      decoded.set(place, new Float32Array(bytes.buffer));
    }
    return decoded.get(place);
  }

  /** Index of the last time that is not after t. */
  function rowAt(times, t) {
    let [low, high] = [0, times.length - 1];
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      [low, high] = times[middle] <= t + 1e-6 ? [middle, high] : [low, middle - 1];
    }
    return low;
  }

  /** A value between rows at time t. */
  function valueAt(times, values, t) {
    const row = rowAt(times, t);
    const next = Math.min(row + 1, times.length - 1);
    const span = times[next] - times[row];
    const share = span > 0 ? Math.min(1, Math.max(0, (t - times[row]) / span)) : 0;
    return (1 - share) * values[row] + share * values[next];
  }

  function make(kind, attributes, parent) {
    const element = document.createElementNS("http://www.w3.org/2000/svg", kind);
    for (const [name, value] of Object.entries(attributes)) {
      if (name === "fill" || name === "stroke") {
        element.style[name] = value; // where variables have their value
      } else {
        element.setAttribute(name, value);
      }
    }
    parent.append(element);
    return element;
  }

  function html(kind, name, parent, text = "") {
    const element = document.createElement(kind);
    element.className = name;
    element.textContent = text;
    parent.append(element);
    return element;
  }

  /** About `count` round numbers of a range, with their texts. */
  function niceTicks([low, high], count) {
    const rough = (high - low) / count;
    const power = 10 ** Math.floor(Math.log10(rough));
    const step = power * [1, 2, 5, 10].find((factor) => factor * power >= rough * (1 - 1e-9));
    const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
    const first = Math.ceil(low / step - 1e-9);
    return Array.from({ length: Math.max(0, Math.floor(high / step + 1e-9) - first + 1) }, (_, k) => {
      const value = (first + k) * step;
      return [value, number(Math.abs(value) < step / 2 ? 0 : value, digits)];
    });
  }

  /** Multiples of π/2, of π or of several π; ordinary ticks in a range that has less than two. */
  function angleTicks([low, high], count) {
    if (high - low < Math.PI) {
      return niceTicks([low, high], count);
    }
    const halves = [1, 2, 4, 10, 20].find((each) => (high - low) / ((each * Math.PI) / 2) <= count + 1) || 40;
    const ticks = [];
    for (let k = Math.ceil(low / (halves * Math.PI / 2)); k * halves * Math.PI / 2 <= high; k++) {
      const half = k * halves;
      const size = half % 2 ? `${Math.abs(half) === 1 ? "" : Math.abs(half)}π/2` : `${Math.abs(half) === 2 ? "" : Math.abs(half) / 2}π`;
      ticks.push([half * Math.PI / 2, half === 0 ? "0" : (half < 0 ? "\u2212" : "") + size]);
    }
    return ticks;
  }

  /** 1, 2 and 5 of each power of ten; the range and the places are logarithms. */
  function logTicks([low, high]) {
    const parts = high - low > 2.5 ? [1] : [1, 2, 5];
    const powers = Array.from({ length: Math.ceil(high) - Math.floor(low) + 1 }, (_, k) => Math.floor(low) + k);
    return powers
      .flatMap((power) => parts.map((part) => [Math.log10(part) + power, String(Number((part * 10 ** power).toPrecision(1)))]))
      .filter(([place]) => low <= place && place <= high);
  }

  class Panel {
    constructor(figure, data, index) {
      Object.assign(this, { figure, data, index });
      this.curves = data.curves.map((curve) => ({
        ...curve,
        x: array(curve.x), y: array(curve.y),
        interval: curve.interval === undefined ? null : array(curve.interval),
        time: curve.time === undefined ? null : array(curve.time),
      }));
      this.root = html("div", "panel-plot", figure.grid);
      if (data.title) {
        html("h5", "", this.root, data.title);
      }
      this.svg = make("svg", { role: "img", "aria-label": `${data.y} over ${data.x}` }, this.root);
      this.full = { x: this.reach("x"), y: this.reach("y") };
      this.listen();
    }

    /** A number on an axis as its place: the logarithm on a logarithmic one. */
    warp(axis, value) {
      return axis === "y" && this.data.logarithmic ? Math.log10(value) : value;
    }

    /** The range that shows everything. */
    reach(axis) {
      if (this.data[`${axis}_range`]) {
        return this.data[`${axis}_range`];
      }
      if (axis === "x" && this.data.ticks.length) {
        return [-0.5, this.data.ticks.length - 0.5];
      }
      let [low, high] = [Infinity, -Infinity];
      const see = (value) => {
        const place = this.warp(axis, value);
        if (Number.isFinite(place)) {
          [low, high] = [Math.min(low, place), Math.max(high, place)];
        }
      };
      for (const curve of this.curves) {
        curve[axis].forEach(see);
        if (axis === "y" && curve.interval) {
          curve.interval.forEach(see);
        }
      }
      this.data.marks.filter((mark) => mark.upright === (axis === "x")).forEach((mark) => see(mark.at));
      if (low > high) {
        return [0, 1];
      }
      const room = axis === "x" && this.figure.data.shared ? 0 : 0.05 * (high - low);
      return high - low > 1e-9 * Math.max(1, Math.abs(high)) ? [low - room, high + room] : [low - 1, high + 1];
    }

    toX(value) {
      const [low, high] = this.range.x;
      return MARGIN.left + ((value - low) / (high - low)) * this.width;
    }

    toY(value) {
      const [low, high] = this.range.y;
      return MARGIN.top + ((high - this.warp("y", value)) / (high - low)) * this.height;
    }

    /** Places on both axes of a pointer event, within the plot. */
    placeOf(event) {
      const box = this.svg.getBoundingClientRect();
      const across = Math.min(1, Math.max(0, (event.clientX - box.left - MARGIN.left) / this.width));
      const down = Math.min(1, Math.max(0, (event.clientY - box.top - MARGIN.top) / this.height));
      const between = ([low, high], share) => low + share * (high - low);
      return { x: between(this.range.x, across), y: between(this.range.y, 1 - down) };
    }

    draw() {
      const lowest = this.index + this.figure.data.columns >= this.figure.panels.length;
      const labelled = lowest || !this.figure.data.shared;
      this.width = Math.max(40, this.root.clientWidth - MARGIN.left - MARGIN.right);
      this.height = this.figure.data.shared ? HEIGHT.shared : HEIGHT.alone;
      const size = [this.width + MARGIN.left + MARGIN.right, this.height + MARGIN.top + (labelled ? MARGIN.bottom : 6)];
      this.svg.replaceChildren();
      this.svg.setAttribute("width", size[0]);
      this.svg.setAttribute("height", size[1]);
      this.axes(labelled);
      // A nested picture cuts what is outside of the plot.
      const box = { x: MARGIN.left, y: MARGIN.top, width: this.width, height: this.height };
      this.plot = make("svg", { ...box, viewBox: Object.values(box).join(" "), class: "plot" }, this.svg);
      for (const mark of this.data.marks) {
        const ends = mark.upright
          ? { x1: this.toX(mark.at), x2: this.toX(mark.at), y1: MARGIN.top, y2: MARGIN.top + this.height }
          : { y1: this.toY(mark.at), y2: this.toY(mark.at), x1: MARGIN.left, x2: MARGIN.left + this.width };
        make("line", { ...ends, stroke: colourOf(mark.colour), "stroke-width": 1.4, "stroke-dasharray": "6 4" }, this.plot);
      }
      this.curves.filter(({ name }) => !this.figure.hidden.has(name)).forEach((curve) => this.curve(curve));
      this.over = make("g", {}, this.svg);
      this.now = make("g", {}, this.plot);
      this.showTime();
    }

    axes(labelled) {
      const [right, bottom] = [MARGIN.left + this.width, MARGIN.top + this.height];
      const counts = { x: this.width / 90, y: this.height / 38 };
      const ticks = (axis) => (this.data.angles.includes(axis) ? angleTicks : niceTicks)(this.range[axis], counts[axis]);
      const across = this.data.ticks.length ? this.data.ticks.map((name, k) => [k, name]) : ticks("x");
      for (const [value, name] of across.filter(([place]) => place >= this.range.x[0] && place <= this.range.x[1])) {
        const x = this.toX(value);
        if (!this.data.ticks.length) {
          make("line", { x1: x, x2: x, y1: MARGIN.top, y2: bottom, stroke: "var(--guide)" }, this.svg);
        }
        if (labelled) {
          const words = this.data.ticks.length && this.width < 110 * across.length ? name.split(" ") : [name];
          words.forEach((word, k) => this.text(word, x, bottom + 15 + 11 * k, "middle", "tick"));
        }
      }
      for (const [value, name] of this.data.logarithmic ? logTicks(this.range.y) : ticks("y")) {
        const y = this.toY(this.data.logarithmic ? 10 ** value : value);
        make("line", { x1: MARGIN.left, x2: right, y1: y, y2: y, stroke: "var(--guide)" }, this.svg);
        this.text(name, MARGIN.left - 6, y + 4, "end", "tick");
      }
      const middle = MARGIN.top + this.height / 2;
      this.text(this.data.y, 13, middle, "middle", "label").setAttribute("transform", `rotate(-90 13 ${middle})`);
      if (labelled && !(this.data.ticks.length && this.width < 110 * across.length)) { // where names have one line
        this.text(this.data.x, MARGIN.left + this.width / 2, bottom + 35, "middle", "label");
      }
    }

    text(words, x, y, anchor, name) {
      const element = make("text", { x, y, "text-anchor": anchor, class: name }, this.svg);
      element.textContent = words;
      return element;
    }

    curve(curve) {
      const colour = colourOf(curve.colour);
      const { width = 0, dash = dashOf(curve.colour), radius = 0, opacity = 1 } = STYLES[curve.look];
      const group = make("g", { "data-name": curve.name, opacity }, this.plot);
      if (curve.look.endsWith("bars")) {
        curve.x.forEach((x, row) => {
          const [left, top] = [this.toX(x - curve.width / 2), this.toY(curve.y[row])];
          const size = { width: this.toX(x + curve.width / 2) - left, height: Math.max(0, this.toY(0) - top) };
          make("rect", { x: left, y: top, ...size, fill: colour }, group);
        });
      } else if (radius) {
        const look = curve.look === "ring" ? { fill: "none", stroke: colour, "stroke-width": 1.5 } : { fill: colour };
        curve.x.forEach((x, row) => {
          const [cx, cy] = [this.toX(x), this.toY(curve.y[row])];
          if (Number.isFinite(cx + cy)) {
            make("circle", { cx, cy, r: radius, ...look }, group);
          }
        });
      } else {
        if (curve.interval) {
          const ends = (side) => Array.from(curve.x, (x, row) => `${this.toX(x).toFixed(1)} ${this.toY(curve.interval[2 * row + side]).toFixed(1)}`);
          make("path", { d: `M${[...ends(0), ...ends(1).reverse()].join("L")}Z`, fill: colour, opacity: 0.18 }, group);
        }
        make("path", {
          d: this.path(curve), fill: "none", stroke: colour, "stroke-width": width, "stroke-dasharray": dash, "stroke-linejoin": "round",
        }, group);
      }
    }

    /** A line through the rows, interrupted where a number is missing. */
    path({ x, y, steps }) {
      let [text, joined] = ["", false];
      for (let row = 0; row < x.length; row++) {
        const [px, py] = [this.toX(x[row]), this.toY(y[row])];
        const known = Number.isFinite(px) && Number.isFinite(py);
        if (known) {
          const [across, down] = [px.toFixed(1), py.toFixed(1)];
          text += !joined ? `M${across} ${down}` : steps ? `H${across}V${down}` : `L${across} ${down}`;
        }
        joined = known;
      }
      return text;
    }

    listen() {
      let start = null;
      this.svg.addEventListener("pointerdown", (event) => {
        if (event.button === 0) {
          start = { event, place: this.placeOf(event), range: this.range };
          this.svg.setPointerCapture(event.pointerId);
        }
      });
      this.svg.addEventListener("pointermove", (event) => {
        const place = this.placeOf(event);
        if (!start) {
          this.figure.inspect(this, place);
        } else if (event.shiftKey) {
          this.move(start, event);
        } else {
          this.select(start.place, place);
        }
      });
      this.svg.addEventListener("pointerup", (event) => {
        if (start && !event.shiftKey) {
          const place = this.placeOf(event);
          const far = Math.hypot(event.clientX - start.event.clientX, event.clientY - start.event.clientY);
          if (far < LEAST_DRAG) {
            this.figure.picked(place.x);
          } else {
            this.zoom(start.place, place);
          }
        }
        start = null;
      });
      this.svg.addEventListener("pointercancel", () => (start = null));
      this.svg.addEventListener("pointerleave", () => this.figure.inspect(null));
      this.svg.addEventListener("dblclick", () => this.figure.reset());
    }

    /** The box that is dragged open. */
    select(from, to) {
      this.over.replaceChildren();
      const [x1, x2] = [from.x, to.x].map((value) => this.toX(value)).sort((a, b) => a - b);
      const back = (value) => (this.data.logarithmic ? 10 ** value : value);
      const [y1, y2] = [from.y, to.y].map((value) => this.toY(back(value))).sort((a, b) => a - b);
      make("rect", { x: x1, y: y1, width: x2 - x1, height: y2 - y1, class: "box" }, this.over);
    }

    zoom(from, to) {
      const range = {};
      for (const axis of ["x", "y"]) {
        const [low, high] = [Math.min(from[axis], to[axis]), Math.max(from[axis], to[axis])];
        const [first, last] = this.range[axis];
        // A drag along one axis leaves the other as it is.
        range[axis] = high - low > 0.04 * (last - first) ? [low, high] : [first, last];
      }
      this.figure.setRange(this, range);
    }

    move(start, event) {
      const shift = (axis, pixels, length) => {
        const [low, high] = start.range[axis];
        const by = (pixels / length) * (high - low);
        return [low - by, high - by];
      };
      const [dx, dy] = [event.clientX - start.event.clientX, event.clientY - start.event.clientY];
      this.figure.setRange(this, { x: shift("x", dx, this.width), y: shift("y", -dy, this.height) });
    }

    /** The curve's row that is nearest to a place, and its distance (pixels). */
    nearest(curve, place, acrossOnly) {
      let best = { row: -1, distance: Infinity };
      const [px, py] = [this.toX(place.x), this.toY(this.data.logarithmic ? 10 ** place.y : place.y)];
      for (let row = 0; row < curve.x.length; row++) {
        const dx = this.toX(curve.x[row]) - px;
        const distance = acrossOnly ? Math.abs(dx) : Math.hypot(dx, this.toY(curve.y[row]) - py);
        if (distance < best.distance && Number.isFinite(curve.y[row])) {
          best = { row, distance };
        }
      }
      return best;
    }

    /** The rows under the pointer: of all curves at its time, or else the nearest of all. */
    found(place) {
      const shown = this.curves.filter(({ name }) => name && !this.figure.hidden.has(name));
      const rows = shown
        .map((curve) => ({ curve, ...this.nearest(curve, place, this.figure.data.shared || curve.look.endsWith("bars")) }))
        .filter(({ distance }) => distance < 40)
        .sort((a, b) => a.distance - b.distance);
      return this.figure.data.shared ? rows.slice(0, 8) : rows.slice(0, 1);
    }

    cross(x) {
      this.over.replaceChildren();
      if (x !== null) {
        const ends = { x1: this.toX(x), x2: this.toX(x), y1: MARGIN.top, y2: MARGIN.top + this.height };
        make("line", { ...ends, stroke: "var(--muted)", "stroke-dasharray": "2 3" }, this.over);
      }
    }

    /** The player's time: a line over a time axis, a dot on a curve whose rows have times. */
    showTime() {
      const t = this.figure.time;
      this.now.replaceChildren();
      if (t === null) {
        return;
      }
      if (this.figure.data.shared) {
        const ends = { x1: this.toX(t), x2: this.toX(t), y1: MARGIN.top, y2: MARGIN.top + this.height };
        make("line", { ...ends, class: "now", stroke: "var(--driven)", "stroke-width": 1.6 }, this.now);
      }
      for (const { x, y, time, look } of this.curves.filter((curve) => curve.time)) {
        const [cx, cy] = [this.toX(valueAt(time, x, t)), this.toY(valueAt(time, y, t))];
        make("circle", { cx, cy, r: look === "line" ? 5 : 3.5, class: "now", fill: "var(--driven)" }, this.now);
      }
    }
  }

  class Figure {
    constructor(root, data, { legend = true, onPick = () => null } = {}) {
      Object.assign(this, { root, legend, onPick, time: null, hidden: new Set() });
      this.show(data);
      new ResizeObserver(() => this.draw()).observe(root);
    }

    /** Draw another description in the same place. */
    show(data) {
      this.data = data;
      this.root.replaceChildren();
      this.head = html("div", "legend", this.root);
      this.grid = html("div", "panels", this.root);
      this.grid.style.setProperty("--columns", data.columns);
      this.tip = html("div", "tip", this.root);
      this.tip.hidden = true;
      this.panels = data.panels.map((panel, index) => new Panel(this, panel, index));
      this.entries();
      this.back = html("button", "reset", this.head, "Reset zoom");
      this.back.type = "button";
      this.back.addEventListener("click", () => this.reset());
      this.reset();
    }

    /** A box for each name, which shows and hides its curves. */
    entries() {
      const names = new Map(this.panels.flatMap(({ curves }) => curves).filter(({ name }) => name).map((curve) => [curve.name, curve]));
      for (const [name, { colour, look }] of this.legend && names.size ? names : []) {
        const label = html("label", look === "pale bars" ? "published" : "", this.head);
        const box = html("input", "", label);
        Object.assign(box, { type: "checkbox", checked: !this.hidden.has(name) });
        const plain = colourOf(colour);
        html("span", "swatch", label).style.background =
          dashOf(colour) === "none" ? plain : `repeating-linear-gradient(90deg, ${plain} 0 2px, transparent 2px 4px)`;
        label.append(name);
        box.addEventListener("change", () => {
          this.hidden[box.checked ? "delete" : "add"](name);
          this.draw();
        });
      }
    }

    /** Panels above each other: all of them with a shared horizontal axis. */
    beside(panel) {
      return this.data.shared ? this.panels.filter(({ index }) => (index - panel.index) % this.data.columns === 0) : [panel];
    }

    reset() {
      for (const panel of this.panels) {
        const group = this.beside(panel).map(({ full }) => full.x);
        panel.range = { x: [Math.min(...group.map(([low]) => low)), Math.max(...group.map(([, high]) => high))], y: panel.full.y };
      }
      this.back.hidden = true;
      this.draw();
    }

    setRange(panel, range) {
      this.beside(panel).forEach((each) => (each.range = { ...each.range, x: range.x }));
      panel.range = range;
      this.back.hidden = false;
      this.draw();
    }

    draw() {
      this.panels.forEach((panel) => panel.draw());
    }

    setTime(t) {
      this.time = t;
      this.panels.forEach((panel) => panel.showTime());
    }

    picked(x) {
      if (this.data.shared) {
        this.onPick(x);
      }
    }

    /** Show the values at a place of a panel; null for none. */
    inspect(panel, place) {
      const rows = panel ? panel.found(place) : [];
      this.panels.forEach((each) => each.cross(null));
      this.tip.hidden = rows.length === 0;
      if (!rows.length) {
        return;
      }
      const { data } = panel;
      const [first] = rows;
      const x = first.curve.x[first.row];
      this.beside(panel).forEach((each) => each.cross(x));
      const across = data.ticks.length ? data.ticks[Math.round(x)] : `${data.x}: ${Number(x.toPrecision(4))}`;
      const lines = rows.map(({ curve, row }) => `${curve.name}: ${Number(curve.y[row].toPrecision(4))}`);
      this.tip.replaceChildren();
      [across, ...lines, data.y].forEach((line) => html("div", "", this.tip, line));
      const [box, own] = [panel.svg.getBoundingClientRect(), this.root.getBoundingClientRect()];
      const left = box.left - own.left + panel.toX(x);
      this.tip.style.left = `${left > own.width / 2 ? left - this.tip.offsetWidth - 14 : left + 14}px`;
      this.tip.style.top = `${box.top - own.top + MARGIN.top}px`;
    }
  }

  Object.assign(swingup, { Figure, array, rowAt, valueAt, number });
})((window.swingup = window.swingup || {}));
