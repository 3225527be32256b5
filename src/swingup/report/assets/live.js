/* The live pendulum: RK4 in real time, the policy at every step, and pushes by keys, buttons and the pointer. */
(function (swingup) {
  "use strict";

  const SPRING = 40; // N/m, from the grabbed point to the pointer
  const DAMPING = 10; // N s/m: the pointer also damps what it holds
  const STRONGEST_PULL = 15; // N
  const NEAR = 0.09; // m: farther from both links, the tip is grabbed
  const PUSH = { force: 1, duration: 0.1 }; // of a key or button, on the tip (N, s)
  const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
  const ARROW_LENGTH = 0.12; // m for each N: how the picture shows a push
  const LONGEST_FRAME = 0.05; // s: a browser that was away skips the time between
  const TRAIL = { points: 40, every: 10 }; // steps
  const FASTEST = 200; // rad/s: nothing physical is faster

  class Live {
    constructor(root, section, robot) {
      this.root = root;
      this.section = section;
      this.robot = robot;
      this.view = new swingup.View(root.querySelector("canvas"), section.parameters, section.driven);
      this.button = Object.fromEntries(
        [...root.querySelectorAll("button")].map((button) => [button.dataset.do, button]),
      );
      this.numbers = Object.fromEntries(
        [...root.querySelectorAll("[data-number]")].map((element) => [element.dataset.number, element]),
      );
      this.policyOn = false;
      this.paused = true;
      this.visible = false;
      this.hand = null; // {link, along, target}: what the pointer holds, and where it is
      this.reset();
      this.listen();
    }

    /** Hang at rest at time 0, the motor off, until the visitor starts or pushes it. */
    reset() {
      this.setPolicy(false);
      this.pause();
      Object.assign(this, { time: 0, steps: 0, x: [0, 0, 0, 0], u: [0, 0], pushes: [], trail: [], spare: 0 });
      this.draw();
    }

    listen() {
      const { canvas } = this.view;
      canvas.addEventListener("pointerdown", (event) => this.grab(event));
      canvas.addEventListener("pointermove", (event) => this.hand && (this.hand.target = this.view.fromPointer(event)));
      ["pointerup", "pointercancel", "lostpointercapture"].forEach((name) =>
        canvas.addEventListener(name, () => (this.hand = null)),
      );
      this.button.reset.addEventListener("click", () => this.reset());
      this.button.pause.addEventListener("click", () => (this.paused ? this.play() : this.pause()));
      this.button.policy.addEventListener("click", () => {
        this.setPolicy(!this.policyOn);
        this.play();
      });
      this.button.left.addEventListener("click", () => this.pushTip([-PUSH.force, 0], PUSH.duration));
      this.button.right.addEventListener("click", () => this.pushTip([PUSH.force, 0], PUSH.duration));
      document.addEventListener("keydown", (event) => this.pressed(event));
      new ResizeObserver(() => this.draw()).observe(canvas);
      swingup.dark.addEventListener("change", () => this.draw());
      new IntersectionObserver(([entry]) => {
        this.visible = entry.isIntersecting;
        this.run();
      }).observe(canvas);
    }

    play() {
      this.paused = false;
      this.button.pause.textContent = "Pause";
      this.run();
    }

    pause() {
      this.paused = true;
      this.button.pause.textContent = "Run";
    }

    setPolicy(on) {
      this.policyOn = on;
      this.button.policy.textContent = on ? "Motor off" : "Swing up";
    }

    /**
     * An arrow key pushes the tip. With the focus in this pendulum's card all four do; with no focus at all left and
     * right do, and up and down scroll the page. A key that is held down pushes on.
     */
    pressed(event) {
      const direction = ARROWS[event.key];
      const inside = this.root.contains(event.target);
      const free = event.target === document.body && this.visible && direction && direction[0] !== 0;
      if (!direction || event.altKey || event.ctrlKey || event.metaKey || !(inside || free)) {
        return;
      }
      event.preventDefault();
      if (!event.repeat || this.pushes.length === 0) {
        this.pushTip(direction.map((part) => PUSH.force * part), PUSH.duration);
      }
    }

    /** Push the tip with a force [fx, fy] (N) for a time (s). */
    pushTip(force, duration) {
      const { parameters: p } = this.section;
      const torque = (x) => swingup.physics.torqueOfForce(p, x, 1, p.l2, force);
      this.pushes.push({ torque, force, until: this.time + duration });
      this.play();
    }

    grab(event) {
      this.view.canvas.setPointerCapture(event.pointerId);
      event.preventDefault();
      this.view.canvas.focus({ preventScroll: true }); // so that the arrow keys push this pendulum
      const target = this.view.fromPointer(event);
      this.hand = { ...this.nearest(target), target };
      this.play();
    }

    /** The point of the pendulum that is nearest to a place: its link and its distance from the link's joint. */
    nearest([x, y]) {
      const { parameters: p } = this.section;
      const [elbow, tip] = swingup.physics.points(p, this.x);
      const links = [[[0, 0], elbow, p.l1], [elbow, tip, p.l2]].map(([from, to, length], link) => {
        const direction = [(to[0] - from[0]) / length, (to[1] - from[1]) / length];
        const projection = (x - from[0]) * direction[0] + (y - from[1]) * direction[1];
        const along = Math.max(0.2 * length, Math.min(length, projection));
        const distance = Math.hypot(x - from[0] - along * direction[0], y - from[1] - along * direction[1]);
        return { link, along, distance };
      });
      const best = links[0].distance < links[1].distance ? links[0] : links[1];
      return best.distance < NEAR ? best : { link: 1, along: p.l2 };
    }

    /** Joint torques of the visitor in this state: pushes, and a damped spring to the pointer. */
    disturbance() {
      this.pushes = this.pushes.filter((push) => this.time < push.until);
      const torques = this.pushes.map((push) => push.torque(this.x));
      if (this.hand) {
        const { link, along, target } = this.hand;
        const { position, velocity } = swingup.physics.pointOn(this.section.parameters, this.x, link, along);
        const pull = [0, 1].map((i) => SPRING * (target[i] - position[i]) - DAMPING * velocity[i]);
        const strength = Math.min(1, STRONGEST_PULL / Math.max(1e-9, Math.hypot(...pull)));
        const force = pull.map((value) => strength * value);
        torques.push(swingup.physics.torqueOfForce(this.section.parameters, this.x, link, along, force));
      }
      return torques.reduce((sum, torque) => [sum[0] + torque[0], sum[1] + torque[1]], [0, 0]);
    }

    /** One step: measure, control, clip, add the visitor's torques, integrate. */
    step() {
      const { parameters, dt, substeps, act } = this.robot;
      this.u = swingup.physics.clip(parameters, this.policyOn ? act(this.x, this.time) : [0, 0]);
      const push = this.disturbance();
      const torques = [this.u[0] + push[0], this.u[1] + push[1]];
      this.x = swingup.physics.rk4Step(parameters, this.x, torques, dt, substeps);
      this.steps += 1;
      this.time = this.steps * dt;
      if (!this.x.every(Number.isFinite) || Math.hypot(this.x[2], this.x[3]) > FASTEST) {
        this.reset();
      }
      if (this.steps % TRAIL.every === 0) {
        this.trail = [...this.trail, swingup.physics.points(parameters, this.x)[1]].slice(-TRAIL.points);
      }
    }

    /** Simulate some seconds at once. */
    advance(seconds) {
      for (let step = Math.round(seconds / this.robot.dt); step > 0; step--) {
        this.step();
      }
      this.draw();
    }

    /** Keep pace with the clock while the pendulum can be seen and is not paused. */
    run() {
      if (this.running || this.paused || !this.visible) {
        return;
      }
      this.running = true;
      let before = null;
      const frame = (now) => {
        if (this.paused || !this.visible) {
          this.running = false;
          return;
        }
        this.spare += before === null ? 0 : Math.min(LONGEST_FRAME, (now - before) / 1000);
        before = now;
        for (; this.spare >= this.robot.dt; this.spare -= this.robot.dt) {
          this.step();
        }
        this.draw();
        requestAnimationFrame(frame);
      };
      requestAnimationFrame(frame);
    }

    /** The latest push on the tip as a line from the tip, null if there is none. */
    shownPush(tip) {
      const push = this.pushes.filter(({ until }) => this.time < until).at(-1);
      return push ? { from: tip, to: tip.map((value, i) => value + ARROW_LENGTH * push.force[i]) } : null;
    }

    draw() {
      const { parameters: p, driven } = this.section;
      const tip = swingup.physics.points(p, this.x)[1];
      const trail = [...this.trail, tip];
      const pull = this.hand
        ? { from: swingup.physics.pointOn(p, this.x, this.hand.link, this.hand.along).position, to: this.hand.target }
        : this.shownPush(tip);
      this.view.draw(this.x, { torque: this.u, trail, pull });
      this.numbers.time.textContent = `${this.time.toFixed(1)} s`;
      this.numbers.torque.textContent = `${swingup.number(this.u[driven], 2)} N m`;
      this.numbers.height.textContent = `${swingup.number(swingup.physics.tipHeight(p, this.x), 2)} m`;
    }
  }

  swingup.Live = Live;
})((window.swingup = window.swingup || {}));
