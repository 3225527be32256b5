/* Plays two recorded swing-ups of one controller side by side: without and with a disturbance. */
(function (swingup) {
  "use strict";

  const TRAIL = 0.6; // s
  const RUNS = ["clean", "disturbed"];

  /** A run's rows as flat arrays: time, states row by row, torques row by row. */
  function decodeRun(run) {
    return run && { time: swingup.decode(run.time), x: swingup.decode(run.x), u: swingup.decode(run.u) };
  }

  /** Index of the last row that is not after t. */
  function rowAt(run, t) {
    let low = 0;
    let high = run.time.length - 1;
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (run.time[middle] <= t + 1e-6) {
        low = middle;
      } else {
        high = middle - 1;
      }
    }
    return low;
  }

  /** State, interpolated between rows, and torque, held from row to row, at time t. */
  function sample(run, t) {
    const row = rowAt(run, t);
    const next = Math.min(row + 1, run.time.length - 1);
    const span = run.time[next] - run.time[row];
    const share = span > 0 ? Math.min(1, Math.max(0, (t - run.time[row]) / span)) : 0;
    const between = (i) => (1 - share) * run.x[4 * row + i] + share * run.x[4 * next + i];
    return { t, x: [0, 1, 2, 3].map(between), u: [run.u[2 * row], run.u[2 * row + 1]] };
  }

  class Player {
    constructor(root, section) {
      this.root = root;
      this.section = section;
      this.shows = section.shows.map((show) => ({
        name: show.name,
        runs: { clean: decodeRun(show.clean), disturbed: decodeRun(show.disturbed) },
      }));
      this.watchers = []; // called as (player, "show" or "time")
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

    /** {t, x, u} of a run ("clean" or "disturbed") at the player's time; null if there is no such run. */
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
      this.tell("show");
      this.seek(Math.min(this.time, this.duration));
    }

    seek(t) {
      this.time = Math.max(0, Math.min(t, this.duration));
      this.slider.value = this.time;
      this.slider.setAttribute("aria-valuetext", `${this.time.toFixed(2)} seconds`);
      this.clock.textContent = `${this.time.toFixed(2)} s`;
      this.draw();
      this.tell("time");
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
      const last = rowAt(rows, this.time);
      const points = [];
      for (let row = rowAt(rows, this.time - TRAIL); row <= last; row++) {
        points.push(swingup.physics.points(this.section.parameters, rows.x.subarray(4 * row, 4 * row + 4))[1]);
      }
      return points;
    }

    tell(what) {
      this.watchers.forEach((watcher) => watcher(this, what));
    }
  }

  swingup.Player = Player;
})((window.swingup = window.swingup || {}));
