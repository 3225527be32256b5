/*
 * A policy file's policy, as in policy/numpy_backend.py: the weights are single-precision numbers, all arithmetic is in
 * double precision, as the judge's.
 */
(function (swingup) {
  "use strict";

  const TURN = 2 * Math.PI;
  const clip = (value, limit) => Math.max(-limit, Math.min(limit, value));
  /** The non-negative remainder. */
  const mod = (value, divisor) => (value % divisor) + (value % divisor < 0 ? divisor : 0);

  /** Single-precision numbers from base64, little-endian as every browser's. */
  function decode(text) {
    return new Float32Array(Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)).buffer);
  }

  const STAGES = {
    pendulum({ angles, velocity_scale: scale }, [q1, q2, dq1, dq2]) {
      const rates = [clip(dq1, scale) / scale, clip(dq2, scale) / scale];
      if (angles === "wrapped") {
        return [...[q1, q2].map((q) => (mod(q, TURN) - Math.PI) / Math.PI), ...rates];
      }
      return [Math.sin(q1), Math.cos(q1), Math.sin(q2), Math.cos(q2), ...rates];
    },
    normalise(stage, seen) {
      const scaled = (value, i) => (value - stage.mean[i]) / Math.sqrt(stage.variance[i] + stage.epsilon);
      return seen.map((value, i) => clip(scaled(value, i), stage.clip));
    },
  };

  const ACTIVATIONS = {
    relu: (x) => Math.max(0, x),
    tanh: Math.tanh,
    elu: (x) => (x > 0 ? x : Math.expm1(x)),
    silu: (x) => 0.5 * x * (1 + Math.tanh(0.5 * x)),
    gelu: (x) => 0.5 * x * (1 + Math.tanh(Math.sqrt(2 / Math.PI) * (x + 0.044715 * x ** 3))),
  };
  const BOUNDS = { tanh: Math.tanh, clip: (x) => clip(x, 1) };

  function apply({ weight, bias }, input) {
    const output = new Float64Array(bias.length);
    for (let row = 0, k = 0; row < bias.length; row++) {
      let sum = bias[row];
      for (let column = 0; column < input.length; column++, k++) {
        sum += weight[k] * input[column];
      }
      output[row] = sum;
    }
    return output;
  }

  /** From what export/javascript.py gives to a function of a state that gives the torques [u1, u2] (N m). */
  function makePolicy(spec, driven) {
    const layers = spec.layers.map(({ weight, bias }) => ({
      weight: decode(weight),
      bias: typeof bias === "string" ? decode(bias) : bias, // double precision is not encoded
    }));
    return (x) => {
      let features = spec.stages.reduce((seen, stage) => STAGES[stage.name](stage, seen), x);
      layers.forEach((layer, depth) => {
        features = apply(layer, features);
        if (depth < layers.length - 1) {
          features = features.map(ACTIVATIONS[spec.activation]);
        }
      });
      // What is clipped must not hide a number that is not finite.
      const torque = x.every(Number.isFinite) ? spec.torque_limit * BOUNDS[spec.bounds](features[0]) : NaN;
      return driven === 0 ? [torque, 0] : [0, torque];
    };
  }

  swingup.decode = decode;
  swingup.makePolicy = makePolicy;
})((window.swingup = window.swingup || {}));
