/*
 * The double pendulum: M(q) q̈ = G(q) + u - C(q, q̇) q̇ - F(q̇), as in dynamics/dynamics.py, and its RK4 step.
 * A state is [q1, q2, dq1, dq2] (rad, rad/s; q1 from hanging down, q2 relative to link 1), a torque [u1, u2] (N m).
 */
(function (swingup) {
  "use strict";

  const COULOMB_STEEPNESS = 100; // s/rad
  const { sin, cos, atan, min, max } = Math;

  /** ẋ = [q̇, q̈] under the joint torques u. */
  function derivative(p, x, u) {
    const [q1, q2, dq1, dq2] = x;
    const h = p.m2 * p.l1 * p.r2;
    const hCos = h * cos(q2);
    const hSin = h * sin(q2);
    const m11 = p.I1 + p.I2 + p.m2 * p.l1 ** 2 + 2 * hCos + p.gr ** 2 * p.Ir + p.Ir;
    const m12 = p.I2 + hCos - p.gr * p.Ir;
    const m22 = p.I2 + p.gr ** 2 * p.Ir;
    const g2 = -p.m2 * p.g * p.r2 * sin(q1 + q2);
    const g1 = -(p.m1 * p.r1 + p.m2 * p.l1) * p.g * sin(q1) + g2;
    const friction1 = p.b1 * dq1 + p.cf1 * atan(COULOMB_STEEPNESS * dq1);
    const friction2 = p.b2 * dq2 + p.cf2 * atan(COULOMB_STEEPNESS * dq2);
    const force1 = u[0] + g1 + hSin * dq2 * (2 * dq1 + dq2) - friction1;
    const force2 = u[1] + g2 - hSin * dq1 * dq1 - friction2;
    const determinant = m11 * m22 - m12 * m12;
    return [dq1, dq2, (m22 * force1 - m12 * force2) / determinant, (m11 * force2 - m12 * force1) / determinant];
  }

  /** The classical fourth-order Runge-Kutta method over dt (s), in equal steps, the torque held. */
  function rk4Step(p, x, u, dt, steps = 1) {
    for (let step = 0; step < steps; step++) {
      x = singleStep(p, x, u, dt / steps);
    }
    return x;
  }

  function singleStep(p, x, u, dt) {
    const along = (slope, time) => x.map((value, i) => value + time * slope[i]);
    const k1 = derivative(p, x, u);
    const k2 = derivative(p, along(k1, 0.5 * dt), u);
    const k3 = derivative(p, along(k2, 0.5 * dt), u);
    const k4 = derivative(p, along(k3, dt), u);
    return x.map((value, i) => value + (dt / 6) * (k1[i] + 2 * k2[i] + 2 * k3[i] + k4[i]));
  }

  /** The motors' torques: each clipped to its joint's limit, which is 0 for a passive joint. */
  function clip(p, u) {
    return [max(-p.tl1, min(p.tl1, u[0])), max(-p.tl2, min(p.tl2, u[1]))];
  }

  /** Elbow and tip [x, y] (m), from the shoulder; y points up. */
  function points(p, x) {
    const elbow = [p.l1 * sin(x[0]), -p.l1 * cos(x[0])];
    return [elbow, [elbow[0] + p.l2 * sin(x[0] + x[1]), elbow[1] - p.l2 * cos(x[0] + x[1])]];
  }

  /** Height of the tip over the shoulder (m). */
  function tipHeight(p, x) {
    return -p.l1 * cos(x[0]) - p.l2 * cos(x[0] + x[1]);
  }

  /** Position and velocity of the point on a link (0 or 1), `along` metres from the link's joint. */
  function pointOn(p, x, link, along) {
    const first = link === 0 ? along : p.l1;
    const second = link === 0 ? 0 : along;
    const [c1, s1, c12, s12] = [cos(x[0]), sin(x[0]), cos(x[0] + x[1]), sin(x[0] + x[1])];
    const both = x[2] + x[3];
    return {
      position: [first * s1 + second * s12, -first * c1 - second * c12],
      velocity: [first * c1 * x[2] + second * c12 * both, first * s1 * x[2] + second * s12 * both],
    };
  }

  /** Joint torques Jᵀ F of a force F = [fx, fy] (N) at that point. */
  function torqueOfForce(p, x, link, along, force) {
    const first = link === 0 ? along : p.l1;
    const second = link === 0 ? 0 : along;
    const elbowPart = second * (cos(x[0] + x[1]) * force[0] + sin(x[0] + x[1]) * force[1]);
    return [first * (cos(x[0]) * force[0] + sin(x[0]) * force[1]) + elbowPart, elbowPart];
  }

  /**
   * The closed loop in the benchmark's order: measure, control, clip, integrate.
   * Returns the rows' time, states before each step, and torques applied at it.
   * `controller(x, t)` gives [u1, u2]; without one the section's policy drives.
   */
  function simulate(robot, x0, steps, controller) {
    const { parameters, dt, substeps, act } = swingup.robots[robot];
    const control = controller || act || (() => [0, 0]);
    const rows = { time: [], x: [], u: [] };
    let x = Array.from(x0);
    for (let step = 0; step < steps; step++) {
      const u = clip(parameters, control(x, step * dt));
      rows.time.push(step * dt);
      rows.x.push(x);
      rows.u.push(u);
      x = rk4Step(parameters, x, u, dt, substeps);
    }
    return rows;
  }

  swingup.physics = { derivative, rk4Step, clip, points, tipHeight, pointOn, torqueOfForce };
  swingup.simulate = simulate;
})((window.swingup = window.swingup || {}));
