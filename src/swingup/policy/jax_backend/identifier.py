"""Online identification of the plant's base parameters from measured angles and commanded torques.

At each measurement, with the rows Y of ``physics.momentum`` for the last angles and the torques of that time:

1. z ← (Y, u̇, -v, u) through three first-order low-passes of equal pole, all columns alike. Now
   Y (θ, κ) + u̇ λ - v γ = u holds for the low-passed columns: κ stands for the offsets of the angles, λ (s) is a lag
   of the torque beside the delay that is known. v is the torque asked of the undriven joint's motor against its
   friction, and γ the part of it that this motor delivers. u and u̇ are 0 in the undriven joint's row, v is in the
   driven one's.
2. For each joint's row φ, y, with the unknowns x = (θ, κ, λ, γ), their covariance P, and the variance r of what the
   row leaves unexplained, with a floor f and a bound b:

       e = y - φᵀ x,   s = φᵀ P φ,   r' = max(r, f),   d² = e² / (s + r'),
       k = P φ / (s + n r' w),   w = max(1, (ν + d²)/(ν + 1)),   x ← x + k e,   P ← P - k (P φ)ᵀ,
       r ← r + a (min(d² r', b) - r),   a fast if r grows, slow if it falls.

   n counts the neighbouring rows whose errors are alike. w is the inverse of Student's weight, ν = 4. A row with d
   above the gate, and rows for a while after it, change nothing but r: pushes.
3. P grows by a small drift. There is no forgetting: what is not excited stays as sure as it was.

A robot's loop may hand over the angles of the call before. Where the times between calls are uneven, the motion
from angle to angle tells whose times they are; where they are even, it does not matter.

The motor's torque is no part of the undriven joint's row. That row alone gives its part of θ up to scale, and noise
of the motor and pushes on the driven joint do not enter it; the driven joint's row adds the scale. Rates are not
used at all: their noise costs nothing. ``docs/policy-format.md`` has all steps. Sources: filtered regression,
Slotine and Li (Applied Nonlinear Control, 9.2); recursive least squares with a variance that adapts to innovations,
Mehra (IEEE Transactions on Automatic Control 15, 1970).
"""

from dataclasses import replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...physics.angles import nearest
from ...physics.base_parameters import BASE, FRICTIONS, Known, Spread, friction_of, lumped, share_allowed
from ...physics.damped import Friction
from ...physics.equations import Lumped
from ...physics.momentum import Maths, momentum_rows
from ...physics.plant import Plant
from ...physics.trigonometry import arctan, sine_cosine
from ...robots import Robot
from ...types import Count, Scalar, Torque
from ..compensation import Compensation, compensation, predicted
from ..identifier_settings import (
    AGE_CAUTION,
    FARTHEST,
    GAIN,
    LAG,
    MOST_DEVIATION,
    POLES,
    SHORTEST_STEP,
    STUDENT,
    TILT1,
    TILT2,
    UNEVEN_FADING,
    UNEVEN_STEP,
    UNKNOWNS,
    IdentifierSettings,
    offsets,
    prior,
)
from .choose import choose

MATHS = Maths(sine_cosine, arctan, jnp.log1p, jnp.where)

Joints = Float[Array, "2"]
Unknowns = Float[Array, "13"]
Covariance = Float[Array, "13 13"]


class IdentifierMemory(eqx.Module):
    """What is remembered from call to call."""

    angles: Float[Array, "depth 2"]
    """Measured angles without jumps of full turns, newest first (rad)."""
    torques: Float[Array, "past 2"]
    """Commanded torques, newest first (N m)."""
    steps: Float[Array, "past"]
    """Time for which each torque was held (s)."""
    calls: Count
    """Measurements since the last restart."""
    delay_steps: Count
    """The delay told last (steps), or ``age`` where that is more."""
    missed: Float[Array, "2"]
    """What the motion misses if angles are those of this call, and if they are those of the one before."""
    age: Count
    """1 if the angles are those of the call before, else 0."""
    filtered: Float[Array, "3 2 14"]
    """States of the low-passes: rows of both joints, with u̇, -v and u in the last columns."""
    unknowns: Unknowns
    """θ, κ1 and κ2 (kg m), the lag (s), and the gain of the undriven joint's motor."""
    covariance: Covariance
    variance: Joints
    """Of what each joint's row leaves unexplained (N² m²)."""
    held: Joints
    """Time for which each joint's row is still not used (s)."""


class Identifier(eqx.Module):
    """Identifies the plant of one loop: ``init``, ``observe`` at each measurement, ``remember`` each command."""

    mean: Float[Any, "13"]
    """θ of the nominal plant, no offsets, no lag, and a gain of 1."""
    covariance: Float[Any, "13 13"]
    """Prior covariance."""
    known: Known = eqx.field(static=True)
    settings: IdentifierSettings = eqx.field(static=True)
    robot: Robot = eqx.field(static=True)
    """Which joint is driven."""

    def init(self) -> IdentifierMemory:
        """Nothing seen yet."""
        span, driven = self.settings.span, jnp.array(self.robot.actuation, float)
        first, most = self.settings.passive_deviation, self.settings.driven_deviation
        past = self.settings.past
        return IdentifierMemory(
            angles=jnp.zeros((2 * span + 1, 2)),
            torques=jnp.zeros((past, 2)),
            steps=jnp.full(past, self.settings.dt),
            calls=jnp.array(0),
            delay_steps=jnp.array(0),
            missed=jnp.zeros(2),
            age=jnp.array(0),
            filtered=jnp.zeros((POLES, 2, UNKNOWNS + 1)),
            unknowns=jnp.asarray(self.mean),
            covariance=jnp.asarray(self.covariance),
            variance=jnp.where(driven > 0, most, first) ** 2,
            held=jnp.zeros(2),
        )

    def restart(self, memory: IdentifierMemory) -> IdentifierMemory:
        """After a pause: what was found stays, the motion before is forgotten."""
        return replace(
            memory,
            torques=jnp.zeros_like(memory.torques),
            steps=jnp.full_like(memory.steps, self.settings.dt),
            calls=jnp.zeros_like(memory.calls),
            filtered=jnp.zeros_like(memory.filtered),
        )

    def remember(self, memory: IdentifierMemory, u: Torque) -> IdentifierMemory:
        """Note the torques that both motors were asked for, the driven one within its limit (N m)."""
        return replace(memory, torques=jnp.concatenate([u[None], memory.torques[:-1]]))

    def observe(self, memory: IdentifierMemory, q: Joints, delay_steps: Count, step: Scalar) -> IdentifierMemory:
        """Learn from measured angles.

        Args:
            memory: of the calls before.
            q: angles (rad), whole turns aside.
            delay_steps: how old they are (steps).
            step: time since the last call (s); of no meaning after a restart.
        """
        before, newest = memory, memory.angles[0] + nearest(q - memory.angles[0])
        angles = jnp.concatenate([newest[None], memory.angles[:-1]])
        dt = self.settings.dt
        step = jnp.where(memory.calls == 0, dt, jnp.maximum(step, SHORTEST_STEP * dt)).astype(memory.steps.dtype)
        steps = jnp.concatenate([step[None], memory.steps[:-1]])
        missed, age = self._age(memory, angles, steps)
        delay_steps = jnp.maximum(delay_steps, age)
        # The lag counts from the delay: their sum is what was found. The old columns belong to the old delay.
        k, changed = jnp.arange(len(steps)), (delay_steps != memory.delay_steps) | (age != memory.age)
        earlier, later = (k < memory.delay_steps).astype(steps.dtype), (k < delay_steps).astype(steps.dtype)
        unknowns = memory.unknowns.at[LAG].add((earlier - later) @ steps)
        filtered = jnp.where(changed, 0.0, memory.filtered)
        calls = memory.calls + 1
        memory = replace(
            memory,
            angles=jnp.where(memory.calls == 0, q, angles),
            steps=steps,
            calls=jnp.minimum(calls, len(memory.angles) + len(memory.torques)),
            delay_steps=delay_steps.astype(memory.delay_steps.dtype),
            missed=missed,
            age=age,
            unknowns=unknowns,
            filtered=filtered,
        )
        learned = self._learn(memory)
        # The torques before a restart are not known.
        full = calls >= len(memory.angles) + delay_steps
        finite = jnp.isfinite(learned.unknowns).all() & jnp.isfinite(learned.covariance).all()
        memory = choose(full & finite, learned, memory)
        # Such an angle would stay in the differences; NaN is none below.
        return choose((jnp.abs(q) < FARTHEST).all(), memory, self.restart(before))

    def plant(self, memory: IdentifierMemory) -> tuple[Lumped, Friction]:
        """The identified plant to predict with: its mass matrix is positive definite, its friction brakes.

        The undriven joint has the friction that its compensation leaves: that motor's torque is not counted.
        """
        theta = self.theta(memory)
        found, left = friction_of(theta), self.compensation(memory).left
        return lumped(theta, self.known), predicted(found, left, self.robot.joint, jnp.maximum)

    def compensation(self, memory: IdentifierMemory) -> Compensation:
        """What the motors are asked for against the friction found, and what is left of it."""
        s, found = self.settings, friction_of(self.theta(memory))
        return compensation(found, memory.unknowns[GAIN], self.robot.joint, s.passive_limit, jnp.maximum)

    def told(self, memory: IdentifierMemory) -> Float[Array, "9"]:
        """θ as a policy and a regulator are told it: with the friction that the compensation leaves."""
        left = self.compensation(memory).left
        return self.theta(memory).at[FRICTIONS].set(jnp.stack([*left[0], *left[1]]))

    def offsets(self, memory: IdentifierMemory) -> Joints:
        """How much the measured angles are too large (rad)."""
        x = memory.unknowns
        return jnp.stack(offsets(x[TILT1], x[TILT2], self.theta(memory), jnp.clip))

    def theta(self, memory: IdentifierMemory) -> Float[Array, "9"]:
        """Base parameters of a pendulum: those found, or as near to them as the mass matrix allows."""
        nominal, found = jnp.asarray(self.mean[:BASE], memory.unknowns.dtype), memory.unknowns[:BASE]
        share = share_allowed(found, nominal, self.known, self.settings.margin, jnp.minimum, jnp.sqrt)
        return nominal + share * (found - nominal)

    def deviation(self, memory: IdentifierMemory) -> Unknowns:
        """Standard deviations of the unknowns, relative to the prior's: 1 is unknown, 0 is sure."""
        least = jnp.diagonal(memory.covariance) / jnp.diagonal(jnp.asarray(self.covariance))
        return jnp.sqrt(jnp.clip(least, 0.0, 1.0))

    def interval(self, memory: IdentifierMemory, step: Scalar) -> Scalar:
        """Time between the measured angles before the last ones are observed and these (s).

        Args:
            memory: of the calls before.
            step: time since the last call (s).
        """
        return jnp.where(memory.age > 0, memory.steps[0], step)

    def _age(
        self, memory: IdentifierMemory, angles: Float[Array, "depth 2"], steps: Float[Array, "past"]
    ) -> tuple[Float[Array, "2"], Count]:
        """Weigh both ages of the angles: a longer step shows as a longer way in the same call, or in the next."""
        whole = 2 * self.settings.span
        rate = (angles[0] - angles[whole]) / jnp.sum(steps[:whole])
        expected = rate * jnp.stack([steps[0] - steps[1], steps[1] - steps[2]])[:, None]
        misses = jnp.sum((angles[0] - 2 * angles[1] + angles[2] - expected) ** 2, axis=1)
        now = jnp.where(memory.calls > whole, jnp.log1p(misses / UNEVEN_STEP**2), 0.0)
        missed = UNEVEN_FADING * memory.missed + now
        more = missed[0] - missed[1]
        age = jnp.where(more > AGE_CAUTION, 1, jnp.where(more < -AGE_CAUTION, 0, memory.age))
        return missed, age.astype(memory.age.dtype)

    def _learn(self, memory: IdentifierMemory) -> IdentifierMemory:
        """The low-passes, both rows, and the drift."""
        weight, stages = self.settings.pole, [self._columns(memory)]
        for stage in memory.filtered:
            stages.append(stage + weight * (stages[-1] - stage))
        memory = replace(memory, filtered=jnp.stack(stages[1:]))
        for joint in (0, 1):
            memory = self._update(memory, joint)
        prior_variance = jnp.diagonal(jnp.asarray(self.covariance, memory.covariance.dtype))
        drift = self.settings.walk**2 * self.settings.dt * prior_variance
        # No less sure than at the start: the drift must not exceed the prior.
        drift = jnp.where(jnp.diagonal(memory.covariance) < prior_variance, drift, 0.0)
        return replace(memory, covariance=memory.covariance + jnp.diag(drift))

    def _columns(self, memory: IdentifierMemory) -> Float[Array, "2 14"]:
        """The newest rows: Y, u̇, -v and u."""
        span = self.settings.span
        newest, middle, oldest = memory.angles[0], memory.angles[span], memory.angles[2 * span]
        pairs = ((oldest[0], oldest[1]), (middle[0], middle[1]), (newest[0], newest[1]))
        acting = jax.lax.dynamic_slice_in_dim(memory.torques, memory.delay_steps, 2 * span)
        steps = jax.lax.dynamic_slice_in_dim(memory.steps, memory.age, 2 * span)
        ages = _ages(steps)
        halves = ages[-1] - ages[span], ages[span]
        ratio = jnp.asarray(self.mean[2] / self.mean[3], newest.dtype)
        shoulder, elbow = momentum_rows(*pairs, halves, self.known, ratio, MATHS)
        mean, slope = hat_weights(steps, ages)
        torque, rate = mean @ acting, slope @ acting
        rows = jnp.stack([jnp.stack(shoulder), jnp.stack(elbow)])
        driven = jnp.array(self.robot.actuation, rows.dtype)
        others = jnp.stack([driven * rate, (driven - 1.0) * torque, driven * torque], axis=1)
        return jnp.concatenate([rows, others], axis=1)

    def _update(self, memory: IdentifierMemory, joint: int) -> IdentifierMemory:
        """One joint's row: the variance of its errors, and what it tells of the unknowns."""
        s, driven = self.settings, self.robot.actuation[joint] > 0
        row, target = memory.filtered[-1, joint, :UNKNOWNS], memory.filtered[-1, joint, UNKNOWNS]
        known = memory.covariance @ row
        unsure, error = row @ known, target - row @ memory.unknowns
        size = jnp.abs(target) + jnp.abs(row[:4]) @ jnp.abs(memory.unknowns[:4])
        floor = (s.driven_floor if driven else s.passive_floor) ** 2 + (s.relative_floor * size) ** 2
        r = jnp.maximum(memory.variance[joint], floor)
        distance = error**2 / (unsure + r)
        held = jnp.where(distance > s.gate**2, s.hold, memory.held[joint] - s.dt)
        heavy = r * s.alike * jnp.maximum(1.0, (STUDENT + distance) / (STUDENT + 1.0))
        gain = jnp.where(held > 0, 0.0, known / (unsure + heavy))
        # A spoilt angle must not blind the identifier for seconds.
        first = s.driven_deviation if driven else s.passive_deviation
        seen = jnp.minimum(distance * r, (MOST_DEVIATION * first) ** 2)
        time = jnp.where(seen > memory.variance[joint], s.rise, s.fall)
        variance = memory.variance[joint] + (1.0 - jnp.exp(-s.dt / time)) * (seen - memory.variance[joint])
        return replace(
            memory,
            unknowns=memory.unknowns + gain * error,
            covariance=memory.covariance - gain[:, None] * known,
            variance=memory.variance.at[joint].set(variance),
            held=memory.held.at[joint].set(jnp.maximum(held, 0.0)),
        )


def hat_weights(
    steps: Float[Array, "2*span"], ages: Float[Array, "2*span+1"]
) -> tuple[Float[Array, "2*span"], Float[Array, "2*span"]]:
    """Weights of the last torques, newest first: for the hat's mean, and for its mean rate (1/s).

    The torque is held over each step, and the hat is integrated over it.

    Args:
        steps: durations of the steps (s), newest first.
        ages: time from each end of a step to the newest (s); the hat's peak is the middle one.
    """
    whole, newer = ages[-1], ages[len(steps) // 2]
    hat = jnp.minimum(ages / newer, (whole - ages) / (whole - newer)) / (0.5 * whole)
    return 0.5 * (hat[1:] + hat[:-1]) * steps, hat[1:] - hat[:-1]


def _ages(steps: Float[Array, "n"]) -> Float[Array, "n+1"]:
    """Time from the ends of steps (s), newest first, to the newest end."""
    return jnp.concatenate([jnp.zeros(1, steps.dtype), jnp.cumsum(steps)])


def make_identifier(
    robot: Robot,
    plant: Plant,
    settings: IdentifierSettings | None = None,
    spread: Spread | None = None,
) -> Identifier:
    """An identifier about a nominal plant.

    Args:
        robot: which joint is driven.
        plant: the nominal plant; its lengths, gear ratio and gravity are taken as known.
        settings: what to expect of the measurement and the torques.
        spread: how far plants lie from the nominal one; None for that of the settings.
    """
    settings = IdentifierSettings() if settings is None else settings
    settings = settings if spread is None else replace(settings, spread=spread)
    mean, covariance = prior(plant, settings)
    known = Known(float(plant.l1), float(plant.g), float(plant.gr))
    return Identifier(mean, covariance, known, settings, robot)
