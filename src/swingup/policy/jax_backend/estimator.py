"""A state estimator before a controller: from the nominal model, the commanded torques and the measurements.

Encoders are good and velocities are noisy, on the real robots as in the robustness benchmark. A Kalman filter takes
velocities mostly from successive positions and the model. The loop may have a delay (an old measurement, a slow
motor): a bank of such filters, one for each delay, tells which explains the measured motion best, and the estimate
is carried ahead over that time with the torques that are still on their way. The steps are those of
``docs/policy-format.md``. With an identifier the model is the plant that it has found so far.
"""

import math
from dataclasses import replace
from typing import Any, TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...control.controller import AbstractController, check_robot
from ...errors import SwingupError
from ...physics import equations
from ...physics.angles import nearest
from ...physics.damped import Friction, damped_midpoint_step
from ...physics.dynamics import acceleration
from ...physics.equations import Lumped, friction, lump
from ...physics.integrate import midpoint_step
from ...physics.plant import Plant
from ...physics.trigonometry import arctan
from ...robots import Robot
from ...types import Count, Scalar, State, Torque
from ..identifier import IdentifierState
from ..identifier_settings import LONGEST_STEP, check_identifier
from ..settings import LOST, PIECES, EstimatorSettings, default_estimator, kalman_gains
from .identifier import Identifier
from .maths import JAX, choose
from .told import told_base

Model: TypeAlias = tuple[Lumped, Friction] | None
"""The plant that was identified; None for the nominal one."""


class EstimatorMemory(eqx.Module):
    """What is remembered from call to call."""

    time: Scalar
    """Time of the last call (s), -inf before the first."""
    state: State
    """Estimate of the measured state, which is as old as the delay."""
    torques: Float[Array, "depth"]
    """Commanded torques, newest first (N m)."""
    deviations: Float[Array, "depth 4"]
    """The bank: what the filter with each delay estimates besides ``state``."""
    surprise: Float[Array, "depth"]
    """Evidence against each delay, the lower the better."""
    delay_steps: Count
    """The delay found (steps)."""
    controller: Any
    """What the controller behind remembers."""
    identified: IdentifierState | None = None
    """What the identifier remembers; None without one."""


class EstimatingController(AbstractController[EstimatorMemory]):
    """A controller that sees an estimate of the state instead of its measurement."""

    controller: AbstractController[Any]
    """The controller behind."""
    parameters: Plant
    """The model."""
    gains: Float[np.ndarray, "2 2"]
    """Kalman gains of a joint, from the misses of its angle and its rate to corrections of both."""
    fading: float
    """Factor on the evidence at each step."""
    settings: EstimatorSettings = eqx.field(static=True)
    robot: Robot = eqx.field(static=True)
    """Which joint is driven."""
    damped: bool = eqx.field(static=True, default=False)
    """Whether the model has friction."""
    identifier: Identifier | None = None
    """Identifies the plant; None for the nominal model."""

    @property
    def passive_limit(self) -> float:
        """Largest torque on the passive joint (N m): the identifier's compensation, and what the controller has."""
        behind = float(getattr(self.controller, "passive_limit", 0.0))
        return behind if self.identifier is None else behind + self.identifier.settings.passive_limit

    def init(self) -> EstimatorMemory:
        """Nothing seen yet."""
        depth = self.settings.max_delay_steps + 1
        return EstimatorMemory(
            time=jnp.array(-jnp.inf),
            state=jnp.zeros(4),
            torques=jnp.zeros(depth),
            deviations=jnp.zeros((depth, 4)),
            surprise=jnp.zeros(depth),
            delay_steps=jnp.array(0),
            controller=self.controller.init(),
            identified=None if self.identifier is None else self.identifier.init(),
        )

    def __call__(self, carry: EstimatorMemory, t: Scalar, x: State) -> tuple[EstimatorMemory, Torque]:
        """The controller's torques for the estimated state (N m), with compensation; x is the measurement."""
        measured, x = x, self._without_offsets(carry, x)
        pause, period = jnp.asarray(t, carry.time.dtype) - carry.time, self.settings.dt
        # Negated, so that the first call (an infinite pause) and a clock of NaN are late as well.
        late = ~((pause >= 0) & (pause <= 1.5 * period))
        # Both branches below are computed: a late call needs a finite step, too.
        dt = jnp.where(late | (pause == 0), period, pause)
        model = self._model(carry)
        followed = self._follow(carry, x, self._interval(carry, dt), model)
        # What is not finite fails the comparison, and is lost.
        kept = jnp.all(jnp.abs(x - followed.state)[2:] <= LOST * self.settings.velocity_noise)
        restarts = late | ~kept
        memory = self._identify(choose(restarts, lambda: self._restart(carry, x), followed), measured, pause)
        # The filter's estimate is as old as the delay; the controller needs the present state.
        ahead = self._ahead(memory, dt, model)
        seen = choose(restarts | ~jnp.all(jnp.isfinite(ahead)), lambda: x, ahead)
        inner, u = self._informed(memory)(carry.controller, t, seen)
        u = u + self._compensation(memory, seen).astype(u.dtype)
        joint = self.robot.joint
        limit = (self.parameters.tl1, self.parameters.tl2)[joint]
        # The model gets the torque that the motor can give.
        newest = jnp.clip(u[joint], -limit, limit)
        torques = jnp.concatenate([newest[None], memory.torques[:-1]])
        identified = memory.identified
        if self.identifier is not None and identified is not None:
            identified = self.identifier.remember(identified, u.at[joint].set(newest))
        # In the memory's own type: a compiled loop keeps the types of its carry.
        now = jnp.asarray(t, carry.time.dtype)
        return replace(memory, time=now, torques=torques, controller=inner, identified=identified), u

    def _model(self, memory: EstimatorMemory) -> Model:
        if self.identifier is None or memory.identified is None:
            return None
        found = self.identifier.found(memory.identified)
        return found.plant, found.friction

    def _informed(self, memory: EstimatorMemory) -> AbstractController[Any]:
        """The controller behind; a policy that sees its plant is told the identified one."""
        if self.identifier is None or memory.identified is None:
            return self.controller
        return told_base(self.controller, jnp.stack(self.identifier.found(memory.identified).told))

    def _without_offsets(self, memory: EstimatorMemory, x: State) -> State:
        """The measurement less the offsets of its angles, as far as they are known."""
        if self.identifier is None or memory.identified is None:
            return x
        return x.at[:2].add(-jnp.stack(self.identifier.found(memory.identified).offsets).astype(x.dtype))

    def _interval(self, memory: EstimatorMemory, dt: Scalar) -> Scalar:
        """Time between the last measurement and this one (s), for calls that are dt apart."""
        if self.identifier is None or memory.identified is None:
            return dt
        return self.identifier.interval(memory.identified, dt)

    def _age(self, memory: EstimatorMemory) -> Count | int:
        """How old the angles are, as far as uneven calls tell (calls)."""
        return 0 if memory.identified is None else memory.identified.age

    def _compensation(self, memory: EstimatorMemory, seen: State) -> Torque:
        """Torques against the friction found (N m); NaN if the state seen is not finite."""
        if self.identifier is None or memory.identified is None:
            return jnp.zeros(2)
        damping, coulomb = map(jnp.stack, self.identifier.found(memory.identified).asked)
        # The arctangent and the clip would make a finite torque of an infinite velocity.
        rates = jnp.where(jnp.isfinite(seen).all(), seen[2:], jnp.nan)
        torques, most = friction(damping, coulomb, rates, arctan), self.identifier.settings.passive_limit
        return jnp.where(jnp.array(self.robot.actuation) > 0, torques, jnp.clip(torques, -most, most))

    def _identify(self, memory: EstimatorMemory, x: State, pause: Scalar) -> EstimatorMemory:
        """Show the identifier, if there is one, the angles measured a pause (s) after the last ones.

        Rates are noisy and not needed.
        """
        if self.identifier is None or memory.identified is None:
            return memory
        # It knows each step's time: the late calls of an uneven loop do not interrupt it. Negated, as above.
        late = ~((pause >= 0) & (pause <= LONGEST_STEP * self.settings.dt))
        before, identifier = memory.identified, self.identifier
        identified = choose(late, lambda: identifier.restart(before), before)
        step = jnp.where(pause == 0, self.settings.dt, pause)
        return replace(memory, identified=identifier.observe(identified, x[:2], memory.delay_steps, step))

    def _restart(self, memory: EstimatorMemory, x: State) -> EstimatorMemory:
        """Believe the measurement; only the evidence on the delay is kept."""
        torques, deviations = jnp.zeros_like(memory.torques), jnp.zeros_like(memory.deviations)
        return replace(memory, state=x, torques=torques, deviations=deviations)

    def _follow(self, memory: EstimatorMemory, x: State, dt: Scalar, model: Model) -> EstimatorMemory:
        """One step of dt (s) of the filter in charge and of the bank.

        The filters of the bank differ only in the torque, and accelerations are linear in the torque. A double
        integrator therefore carries their deviations on; only the filter in charge needs the model.
        """
        dt, driven = dt.astype(x.dtype), jnp.array(self.robot.actuation, x.dtype)
        torque = memory.torques[memory.delay_steps]
        predicted = self._step(model, memory.state, torque * driven, dt)
        miss = x - predicted
        miss = miss.at[:2].set(nearest(miss[:2]))

        extra = (memory.torques - torque)[:, None] * self._response(model, memory.state, driven)
        angles, rates = memory.deviations[:, :2], memory.deviations[:, 2:]
        drifted = jnp.concatenate([angles + dt * rates + 0.5 * dt**2 * extra, rates + dt * extra], axis=1)
        misses = miss - drifted

        scaled = jnp.sum(misses[:, :2] ** 2, axis=1) / self.settings.residual_scale**2
        surprise = self.fading * memory.surprise + jnp.log1p(scaled)
        # A delay below the angles' own age cannot be.
        beyond = jnp.arange(len(surprise)) - self._age(memory)
        evidence = surprise + self.settings.caution * beyond
        delay_steps = jnp.argmin(jnp.where(beyond < 0, jnp.inf, evidence))

        deviations = drifted - self._correction(drifted)
        in_charge = deviations[delay_steps]
        return replace(
            memory,
            state=predicted + self._correction(miss) + in_charge,
            # They count from the filter in charge, which may be another one now.
            deviations=deviations - in_charge,
            surprise=surprise,
            delay_steps=delay_steps.astype(memory.delay_steps.dtype),
        )

    def _response(self, model: Model, x: State, driven: Torque) -> Float[Array, "2"]:
        """M⁻¹ times the torque of 1 N m on the driven joint (rad/s²)."""
        if model is not None:
            return jnp.asarray(equations.response(model[0], jnp.cos(x[1]), driven, jnp.stack))
        # Gravity cancels in the difference, and nothing else acts at rest, friction included.
        p, at_rest = self.parameters, jnp.concatenate([x[:2], jnp.zeros(2)])
        return acceleration(p, at_rest, driven) - acceleration(p, at_rest, jnp.zeros(2))

    def _correction(self, miss: Float[Array, "*n 4"]) -> Float[Array, "*n 4"]:
        """What the Kalman gains make of a miss."""
        gains = jnp.asarray(self.gains, miss.dtype)
        angles, rates = miss[..., :2], miss[..., 2:]
        return jnp.concatenate(
            [gains[0, 0] * angles + gains[0, 1] * rates, gains[1, 0] * angles + gains[1, 1] * rates], axis=-1
        )

    def _ahead(self, memory: EstimatorMemory, dt: Scalar, model: Model) -> State:
        """The state after the delay, steps of dt (s), in pieces with the mean of the torques that act in each."""
        driven = jnp.array(self.robot.actuation, memory.state.dtype)
        steps = memory.delay_steps.astype(memory.state.dtype) / PIECES
        ages = jnp.arange(len(memory.torques))
        x = memory.state
        for left in range(PIECES, 0, -1):
            # How much of each torque's step lies in the piece: it began and will end so many steps ago.
            within = jnp.clip(left * steps - ages, 0, 1) - jnp.clip((left - 1) * steps - ages, 0, 1)
            # Without a delay the pieces are empty: 0 / 0 would be NaN.
            torque = jnp.sum(within * memory.torques) / jnp.maximum(steps, 1e-6)
            x = self._step(model, x, torque * driven, steps * dt.astype(x.dtype))
        return x

    def _step(self, model: Model, x: State, u: Torque, dt: Scalar) -> State:
        """The model's step over dt (s)."""
        p = self.parameters
        if model is None and not self.damped:
            return midpoint_step(p, x, u, dt)
        plant, friction = model or (lump(p), Friction((p.b1, p.b2), (p.cf1, p.cf2)))
        return jnp.array(damped_midpoint_step(plant, friction, x, u, dt, JAX))


def with_estimator(
    controller: AbstractController[Any],
    robot: Robot,
    parameters: Plant,
    settings: EstimatorSettings | None = None,
    identifier: Identifier | None = None,
) -> EstimatingController:
    """Put an estimator in front of a controller.

    Args:
        controller: the controller; called with estimates of the state.
        robot: which joint is driven.
        parameters: the model, with the motor's torque limit.
        settings: what to expect of measurement and loop; the defaults in the model's units if None.
        identifier: finds the plant, whose model the estimator then has; None for the nominal model.

    Raises:
        SwingupError: the controller is for the other robot, the model has no units of its own, or the identifier
            is for another loop.
    """
    check_robot(controller, robot)
    settings = default_estimator(parameters) if settings is None else settings
    if identifier is not None:
        _check_fits(identifier, robot, settings)
    gains, fading = kalman_gains(settings), math.exp(-settings.dt / settings.memory)
    p = parameters
    # Values of JAX may be traced: they count as friction.
    damped = any(isinstance(value, jax.Array) or value != 0 for value in (p.b1, p.b2, p.cf1, p.cf2))
    return EstimatingController(controller, parameters, gains, fading, settings, robot, damped, identifier)


def _check_fits(identifier: Identifier, robot: Robot, settings: EstimatorSettings) -> None:
    """Refuse an identifier that was made for another robot, another period or shorter delays."""
    if identifier.robot.name != robot.name:
        raise SwingupError(f"the identifier is for the {identifier.robot.name}: make one for the {robot.name}")
    check_identifier(identifier.settings, settings)
