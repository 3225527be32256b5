/* One picture of the pendulum on a canvas; proportions as in drawing.py, colours from the style sheet. */
(function (swingup) {
  "use strict";

  const MARGIN = 1.15; // half the width of the picture in units of l1 + l2
  const GOAL = 0.9; // height of the goal line in units of l1 + l2
  const FULL_ARC = (150 / 180) * Math.PI; // length of the arrow that stands for the largest torque

  /** The style sheet's colours, read again when the page turns dark or light. */
  function readColours() {
    const style = getComputedStyle(document.documentElement);
    const read = (name) => style.getPropertyValue(name).trim();
    return {
      paper: read("--picture"), guide: read("--guide"), base: read("--base"), goal: read("--goal"),
      link1: read("--link-1"), link2: read("--link-2"), driven: read("--driven"), ink: read("--ink"),
    };
  }

  let colours = null;
  swingup.dark = window.matchMedia("(prefers-color-scheme: dark)");
  swingup.dark.addEventListener("change", () => (colours = null));

  class View {
    /** A canvas that shows the pendulum of these parameters, one of whose joints is driven. */
    constructor(canvas, parameters, driven) {
      this.canvas = canvas;
      this.parameters = parameters;
      this.driven = driven;
      this.limit = Math.max(parameters.tl1, parameters.tl2); // N m
      this.context = canvas.getContext("2d");
    }

    /** Fit the canvas to its place in the page, at the screen's resolution. */
    fit() {
      const side = this.canvas.clientWidth || 320;
      const pixels = Math.round(side * Math.min(window.devicePixelRatio || 1, 3));
      if (this.canvas.width !== pixels) {
        this.canvas.width = this.canvas.height = pixels;
      }
      this.context.setTransform(pixels / side, 0, 0, pixels / side, 0, 0);
      this.side = side;
      this.scale = side / (2 * MARGIN * (this.parameters.l1 + this.parameters.l2));
    }

    toScreen([x, y]) {
      return [this.side / 2 + this.scale * x, this.side / 2 - this.scale * y];
    }

    /** A pointer event's place in metres from the shoulder. */
    fromPointer(event) {
      const box = this.canvas.getBoundingClientRect();
      const scale = box.width / (2 * MARGIN * (this.parameters.l1 + this.parameters.l2));
      return [(event.clientX - box.left - box.width / 2) / scale, (box.top + box.height / 2 - event.clientY) / scale];
    }

    /** Draw a state; options: torque [u1, u2], trail [[x, y], ...] (m), pull {from, to} (m). */
    draw(x, { torque = [0, 0], trail = [], pull = null } = {}) {
      colours = colours || readColours();
      this.fit();
      const unit = this.side / 100;
      const shoulder = [this.side / 2, this.side / 2];
      const [elbow, tip] = swingup.physics.points(this.parameters, x).map((point) => this.toScreen(point));
      this.scenery(shoulder, unit);
      this.trail(trail, unit);
      this.line(shoulder, elbow, colours.link1, 3.4 * unit);
      this.line(elbow, tip, colours.link2, 3.4 * unit);
      this.disc(tip, 2.4 * unit, colours.link2);
      [shoulder, elbow].forEach((joint, index) => {
        this.disc(joint, 2.8 * unit, colours.link1);
        this.disc(joint, 1.6 * unit, index === this.driven ? colours.driven : colours.paper);
        this.arrow(joint, torque[index], unit);
      });
      if (pull) {
        this.pull(this.toScreen(pull.from), this.toScreen(pull.to), unit);
      }
    }

    scenery([x, y], unit) {
      const c = this.context;
      const reach = (this.parameters.l1 + this.parameters.l2) * this.scale;
      c.fillStyle = colours.paper;
      c.fillRect(0, 0, this.side, this.side);
      c.strokeStyle = colours.guide;
      c.lineWidth = 0.4 * unit;
      c.beginPath();
      c.arc(x, y, reach, 0, 2 * Math.PI);
      c.stroke();
      c.fillStyle = colours.guide;
      c.beginPath();
      c.moveTo(x, y);
      c.lineTo(x - 5 * unit, y + 6 * unit);
      c.lineTo(x + 5 * unit, y + 6 * unit);
      c.fill();
      this.line([x - 7.5 * unit, y + 6 * unit], [x + 7.5 * unit, y + 6 * unit], colours.base, 0.9 * unit, "butt");
      const goal = y - GOAL * reach;
      c.setLineDash([2.4 * unit, 1.6 * unit]);
      this.line([0, goal], [this.side, goal], colours.goal, 0.7 * unit, "butt");
      c.setLineDash([]);
    }

    /** The tip's path, older parts fainter; the latest point comes last. */
    trail(trail, unit) {
      const c = this.context;
      for (let i = 1; i < trail.length; i++) {
        c.globalAlpha = (0.55 * i) / trail.length;
        this.line(this.toScreen(trail[i - 1]), this.toScreen(trail[i]), colours.link2, 0.8 * unit, "butt");
      }
      c.globalAlpha = 1;
    }

    /** An arrow that starts above the joint and turns with the torque, counter-clockwise if it is positive. */
    arrow([x, y], torque, unit) {
      const sweep = FULL_ARC * Math.max(-1, Math.min(1, torque / this.limit));
      if (Math.abs(sweep) < 0.05) {
        return;
      }
      const c = this.context;
      const radius = 6.5 * unit;
      const at = (angle, distance) => [x - distance * Math.sin(angle), y - distance * Math.cos(angle)];
      c.strokeStyle = c.fillStyle = colours.driven;
      c.lineWidth = 1.1 * unit;
      c.lineCap = "butt";
      c.beginPath();
      c.arc(x, y, radius, -Math.PI / 2, -Math.PI / 2 - sweep, sweep > 0);
      c.stroke();
      c.beginPath();
      c.moveTo(...at(sweep, radius - 2 * unit));
      c.lineTo(...at(sweep, radius + 2 * unit));
      c.lineTo(...at(sweep + Math.sign(sweep) * 0.5, radius));
      c.fill();
    }

    pull(from, to, unit) {
      this.context.setLineDash([1.2 * unit, 1.2 * unit]);
      this.line(from, to, colours.ink, 0.8 * unit, "butt");
      this.context.setLineDash([]);
      this.disc(from, 1.3 * unit, colours.ink);
      this.disc(to, 2 * unit, colours.ink);
    }

    line([x1, y1], [x2, y2], colour, width, cap = "round") {
      const c = this.context;
      c.strokeStyle = colour;
      c.lineWidth = width;
      c.lineCap = cap;
      c.beginPath();
      c.moveTo(x1, y1);
      c.lineTo(x2, y2);
      c.stroke();
    }

    disc([x, y], radius, colour) {
      this.context.fillStyle = colour;
      this.context.beginPath();
      this.context.arc(x, y, radius, 0, 2 * Math.PI);
      this.context.fill();
    }
  }

  swingup.View = View;
})((window.swingup = window.swingup || {}));
