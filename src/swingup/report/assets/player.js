/* Plays two recorded swing-ups of one controller side by side: without and with a disturbance. */
(function (swingup) {
  "use strict";

  const TRAIL = 0.6; // s
  const RUNS = ["undisturbed", "disturbed"];

  /** A run's columns: time, four of states, two of torques. */
  function decodeRun(run) {
    return run && { time: swingup.array(run.time), x: run.x.map(swingup.array), u: run.u.map(swingup.array) };
  }

  /** State, interpolated between rows, and torque, held from row to row, at time t. */
  function sample(run, t) {
    const row = swingup.rowAt(run.time, t);
    return { t, x: run.x.map((values) => swingup.valueAt(run.time, values, t)), u: run.u.map((values) => values[row]) };
  }

  class Player {
    constructor(root, section) {
      this.root = root;
      this.section = section;
      this.shows = section.shows.map((show) => ({
        name: show.name,
        runs: Object.fromEntries(RUNS.map((run) => [run, decodeRun(show.runs[run])])),
        figures: show.figures,
      }));
      this.time = 0;
      this.speed = 1;
      this.playing = false;
      this.find();
      this.listen();
      this.select(0);
    }

    find() {
      const one = (selector) => this.root.querySelector(selector);
      this.button = one("[data-play]");
      this.slider = one("input[type=range]");
      this.clock = one("[data-time]");
      this.speeds = one("select");
      this.choices = [...this.root.querySelectorAll("input[type=radio]")];
      this.stages = RUNS.map((run) => {
        const stage = one(`[data-run=${run}]`);
        const canvas = stage.querySelector("canvas");
        const view = new swingup.View(canvas, this.section.parameters, this.section.driven);
        return { run, stage, canvas, view, numbers: stage.querySelector("[data-state]") };
      });
      const options = { legend: false, onPick: (t) => this.seek(t) };
      const { figures } = this.shows[0];
      this.figures = Object.fromEntries(
        Object.keys(figures).map((name) => [name, new swingup.Figure(one(`[data-plot=${name}]`), figures[name], options)]),
      );
    }

    listen() {
      this.button.addEventListener("click", () => (this.playing ? this.pause() : this.play()));
      this.slider.addEventListener("input", () => this.seek(Number(this.slider.value)));
      this.speeds.addEventListener("change", () => (this.speed = Number(this.speeds.value)));
      this.choices.forEach((choice, index) => choice.addEventListener("change", () => this.select(index)));
      new ResizeObserver(() => this.draw()).observe(this.stages[0].canvas);
      swingup.dark.addEventListener("change", () => this.draw());
    }

    /** The selected controller's recordings. */
    get show() {
      return this.shows[this.index];
    }

    /** Last moment of the longer run (s). */
    get duration() {
      return Math.max(...RUNS.map((run) => this.show.runs[run]).map((run) => (run ? run.time[run.time.length - 1] : 0)));
    }

    /** {t, x, u} of a run ("undisturbed" or "disturbed") at the player's time; null if there is no such run. */
    state(run) {
      const rows = this.show.runs[run];
      return rows && sample(rows, this.time);
    }

    select(index) {
      this.index = index;
      this.choices[index].checked = true;
      for (const { run, stage, canvas } of this.stages) {
        stage.hidden = !this.show.runs[run];
        canvas.setAttribute("aria-label", `${this.section.robot} driven by ${this.show.name}, ${run}`);
      }
      this.slider.max = this.duration.toFixed(2);
      Object.entries(this.figures).forEach(([name, figure]) => figure.show(this.show.figures[name]));
      this.seek(Math.min(this.time, this.duration));
    }

    seek(t) {
      this.time = Math.max(0, Math.min(t, this.duration));
      this.slider.value = this.time;
      this.slider.setAttribute("aria-valuetext", `${this.time.toFixed(2)} seconds`);
      this.clock.textContent = `${this.time.toFixed(2)} s`;
      this.draw();
      Object.values(this.figures).forEach((figure) => figure.setTime(this.time));
    }

    play() {
      if (this.time >= this.duration) {
        this.seek(0);
      }
      this.setPlaying(true);
      let before = null;
      const frame = (now) => {
        if (!this.playing) {
          return;
        }
        const passed = before === null ? 0 : Math.min(0.1, (now - before) / 1000);
        before = now;
        this.seek(this.time + this.speed * passed);
        if (this.time >= this.duration) {
          this.pause();
        } else {
          this.frame = requestAnimationFrame(frame);
        }
      };
      this.frame = requestAnimationFrame(frame);
    }

    pause() {
      cancelAnimationFrame(this.frame);
      this.setPlaying(false);
    }

    setPlaying(playing) {
      cancelAnimationFrame(this.frame);
      this.playing = playing;
      this.button.textContent = playing ? "Pause" : "Play";
      this.button.classList.toggle("is-on", playing);
    }

    draw() {
      for (const { run, view, numbers } of this.stages) {
        const state = this.state(run);
        if (state) {
          view.draw(state.x, { torque: state.u, trail: this.trail(run) });
          const torque = swingup.number(state.u[this.section.driven], 2);
          const height = swingup.number(swingup.physics.tipHeight(this.section.parameters, state.x), 2);
          numbers.textContent = `${torque}\u00a0N\u00a0m · tip at ${height}\u00a0m`;
        }
      }
    }

    trail(run) {
      const rows = this.show.runs[run];
      const last = swingup.rowAt(rows.time, this.time);
      const points = [];
      for (let row = swingup.rowAt(rows.time, this.time - TRAIL); row <= last; row++) {
        points.push(swingup.physics.points(this.section.parameters, rows.x.map((values) => values[row]))[1]);
      }
      return points;
    }
  }

  swingup.Player = Player;
})((window.swingup = window.swingup || {}));
