"""The analytic policy gradient: backwards through policy and pendulum over whole episodes, then a step of Adam.

The cost of an episode is a weighted sum of measures that are smooth, so that they have a gradient. Initial states
are drawn at random, new ones for every step. Throws are drawn by the rules of the global-policy score; none of them
is one of the benchmark's own.
"""

import functools
import itertools
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Array, Bool, Float

from ..areapo.networks import Actor
from ..benchmark.boards import PERFORMANCE
from ..benchmark.rollout import Scenario, Trajectory, simulate
from ..benchmark.swing_up_board import realai_score
from ..common import DISPATCH, cores
from ..common.types import Scalar, State
from ..controllers.interface import AbstractController
from ..controllers.stack.policy import PolicyController
from ..dynamics.dynamics import UPRIGHT, tip_height
from ..dynamics.integrate import stable_substeps
from ..loop.starts import Starts, sample_starts
from ..plant.plant import Plant, Robot
from ..tasks.pendulum import UP_LINE_WIDTH

SCORE_RULES = PERFORMANCE  # The rules whose score the objective smooths, and whose time step the episodes have
GOAL_WIDTH = 0.3  # width of the goal's neighbourhood (rad)
SPEED_OF_A_RADIAN = 4.0  # the velocity that counts as much as an error of one radian (rad/s)
FAST = 14.0  # the velocity from which on a joint is fast (rad/s). Loops of real robots stop at 20
WOUND = 2.0
"""Half turns from upright from which on a joint is wound. Loops of real robots stop at 3.5 or 4 from hanging."""
LEARNING_RATE = 5e-4
"""Maximum step size of Adam: it rises over the first eighth of the steps and falls to a fiftieth on a cosine."""
ADJOINT_LIMIT = 4.0  # Maximum norm of an episode's gradient with respect to one of its states (1/rad, s/rad)
REPORT_EVERY = 10  # gradient steps between reports
GRADIENT_LIMIT = 0.5  # maximum norm of the policy's gradient; a larger one is scaled down


class Measures(eqx.Module):
    """The measures of an episode."""

    score: Scalar  # The RealAI score, in which the smoothly counted time down replaces the swing-up time
    down: Scalar  # Share of the time for which the tip is down
    away: Scalar
    """Mean distance from the goal, from 0 to 1. Half of it saturates outside the goal's neighbourhood."""
    fast: Scalar  # Mean over the rows of the joints' squared velocities above FAST, in units of it
    wound: Scalar  # Mean sum of squares of the joints' half turns from upright beyond WOUND


def measure_episode(trajectory: Trajectory, parameters: Plant) -> Measures:
    """Measure an episode. The time after it counts as free of cost."""
    x, u, dt = jnp.asarray(trajectory.x), jnp.asarray(trajectory.u), SCORE_RULES.dt
    line = SCORE_RULES.height * parameters.length
    down = jnp.sum(jax.nn.sigmoid((line - jax.vmap(tip_height, (None, 0))(parameters, x)) / UP_LINE_WIDTH)) * dt
    changes = jnp.diff(u, axis=0)
    # The rows of a whole run, as in the judge: after the episode the torque counts as constant.
    rows = SCORE_RULES.steps - 1
    mean, square = jnp.sum(changes, axis=0) / rows, jnp.sum(changes**2, axis=0) / rows
    costs = {
        "swingup_time": down,
        "energy": jnp.sum(jnp.abs(jnp.diff(x[:, :2], axis=0) * u[:-1])),
        "torque_cost": jnp.sum(u**2) * dt,
        # The passive joint's torque is always 0, where a square root has no finite slope.
        "torque_smoothness": jnp.sum(jnp.sqrt(square - mean**2 + 1e-12)),
        "velocity_cost": jnp.sum(x[:, 2:] ** 2) * dt,
    }
    score = realai_score(costs, SCORE_RULES.normalisers, jnp.tanh)
    above = jax.nn.relu(jnp.abs(x[:, 2:]) / FAST - 1)
    turns = jax.nn.relu(jnp.abs(x[:, :2] - jnp.asarray(UPRIGHT[:2], x.dtype)) / jnp.pi - WOUND)
    away, fast = jnp.mean(jax.vmap(_away)(x)), jnp.mean(jnp.sum(above**2, axis=1))
    return Measures(score, down / (dt * len(x)), away, fast, jnp.mean(jnp.sum(turns**2, axis=1)))


def _away(x: State) -> Scalar:
    # Distance from upright at rest, from 0 to 1. The far term alone is flat at the goal, the near one far from it:
    # their sum has a slope everywhere.
    tilt, bend = 2 + 2 * jnp.cos(x[0]), 2 - 2 * jnp.cos(x[1])  # squared chords
    far = (0.6 * tilt + 0.4 * bend) / 4
    near = tilt + bend + jnp.sum(x[2:] ** 2) / SPEED_OF_A_RADIAN**2
    return 0.5 * far + 0.5 * (1 - jnp.exp(-0.5 * near / GOAL_WIDTH**2))


@dataclass(frozen=True)
class EpisodeWeights:
    """Weights of an episode's measures. ``score`` lowers the cost, the others add to it."""

    score: float = 0.0
    down: float = 0.0
    away: float = 0.0
    fast: float = 0.0
    wound: float = 0.0

    def cost(self, measures: Measures) -> Scalar:
        """The cost that the gradient steps minimise."""
        bad = self.down * measures.down + self.away * measures.away + self.fast * measures.fast
        return bad + self.wound * measures.wound - self.score * measures.score


@dataclass(frozen=True)
class GradientStage:
    """A stage of gradient steps for a policy of one plant."""

    weights: EpisodeWeights  # What the episodes minimise
    steps: int = 900  # Gradient steps
    duration: float = 1.5  # Length of an episode (s)
    episodes: int = 202  # Episodes of a step
    starts: Starts = Starts(thrown=180, anywhere=18, hanging=4, speed=8.0, spread=0.0115)  # noqa: RUF009 - frozen
    """Where they begin."""


def sample_episodes(
    random: np.random.Generator, robot: Robot, stage: GradientStage, plant: Plant
) -> tuple[Float[np.ndarray, "n 4"], Bool[np.ndarray, "n"]]:
    """Initial states (rad, rad/s) of one step's episodes, in single precision, and which of them start hanging."""
    x0 = sample_starts(random, plant.driven(robot), stage.starts, stage.episodes).astype(np.float32)
    # Shuffled: each core takes a slice of the batch, and every slice needs episodes of all kinds.
    order = random.permutation(len(x0))
    # The hanging ones come last before the shuffle.
    return x0[order], order >= len(x0) - stage.starts.counts(len(x0))["hanging"]


class AnalyticPolicyGradient:
    """Gradient steps for one controller: a part of each batch on every core, or one batch on an accelerator."""

    def __init__(self, controller: PolicyController, stage: GradientStage, plant: Plant) -> None:
        self._plant = plant.driven(controller.robot)
        # The actor is differentiated, and so an argument of its own; here it is left out.
        self._controller = eqx.tree_at(lambda c: c.policy.actor, single_precision(controller), None)
        self._stage = stage
        rate, number = LEARNING_RATE, stage.steps
        schedule = optax.warmup_cosine_decay_schedule(0.0, rate, number // 8, number, rate / 50)
        bounded = optax.clip_by_global_norm(GRADIENT_LIMIT)
        self._optimiser = optax.chain(bounded, optax.adam(schedule, b2=0.98))
        self._apply = jax.jit(self._updated)
        self.actor: Actor = single_precision(controller.policy.actor)
        """The network after the steps so far."""
        self._moments = self._optimiser.init(self.actor)

    def step(self, x0: Float[np.ndarray, "n 4"]) -> Measures:
        """Take one step on episodes from these states, and return their measures (leading axis: episode)."""
        # One compiled batch keeps one core busy; threads share the batch out.
        number = len(x0)
        parts = min(cores(), number) if jax.default_backend() == "cpu" else 1
        cuts = np.linspace(0, number, parts + 1).astype(int)
        pieces = [slice(*ends) for ends in itertools.pairwise(cuts)]

        def run(piece: slice) -> tuple[tuple[Scalar, Measures], Actor]:
            some = jnp.asarray(x0[piece])
            with DISPATCH:
                gradient = _gradient(self.actor, self._controller, some, self._stage, self._plant)
            return jax.block_until_ready(gradient)

        with ThreadPoolExecutor(parts) as pool:
            results = list(pool.map(run, pieces))
        # Parts may differ by an episode: each mean counts by its share of the batch.
        shares = np.diff(cuts) / cuts[-1]
        gradients = [gradient for _, gradient in results]
        self.actor, self._moments = self._apply(self.actor, self._moments, gradients, shares)
        return jax.tree.map(lambda *leaves: np.concatenate(leaves), *[measures for (_, measures), _ in results])

    def _updated(
        self, actor: Actor, moments: optax.OptState, gradients: list[Actor], shares: np.ndarray
    ) -> tuple[Actor, optax.OptState]:
        mean = jax.tree.map(lambda *parts: sum(a * b for a, b in zip(shares, parts, strict=True)), *gradients)
        updates, moments = self._optimiser.update(mean, moments)
        return optax.apply_updates(actor, updates), moments


def descend(
    controller: PolicyController,
    stage: GradientStage,
    random: np.random.Generator,
    report: Callable[[PolicyController, int, dict[str, float]], None],
    plant: Plant,
) -> PolicyController:
    """The controller after the steps of a stage; reported with their number and means over the latest ones."""
    learner = AnalyticPolicyGradient(controller, stage, plant)
    recent: list[dict[str, float]] = []
    for number in range(1, stage.steps + 1):
        x0, hanging = sample_episodes(random, controller.robot, stage, plant)
        measures = learner.step(x0)
        means = {"nominal_score": measures.score[hanging], "others_down": measures.down[~hanging]}
        recent.append({name: float(np.mean(values)) for name, values in means.items() if values.size})
        if number % REPORT_EVERY == 0 or number == stage.steps:
            controller = with_actor(controller, jax.tree.map(np.asarray, learner.actor))
            report(
                controller, number, {name: float(np.mean([each[name] for each in recent])) for name in recent[0]}
            )
            recent.clear()
    return controller


def batch_cost(
    actor: Actor, controller: PolicyController, x0: Float[Array, "n 4"], stage: GradientStage, plant: Plant
) -> tuple[Scalar, Measures]:
    """Mean cost of a batch of episodes under a policy with this actor, and the episodes' measures.

    The cost is differentiated with respect to the actor, which replaces the controller's own.
    """
    measures = run_episodes(with_actor(controller, actor), x0, stage.duration, plant)
    return jnp.mean(stage.weights.cost(measures)), measures


_gradient = jax.jit(jax.value_and_grad(batch_cost, has_aux=True), static_argnames=("stage", "plant"))


def run_episodes(
    controller: AbstractController[Any], x0: Float[Array, "n 4"], duration: float, plant: Plant
) -> Measures:
    """The measures (leading axis: episode) of episodes (s) on a plant, whose gradients are bounded."""
    scenario = Scenario(plant, substeps=stable_substeps(plant, SCORE_RULES.dt))
    limit = ADJOINT_LIMIT / len(x0)  # the mean gives each episode this share of its gradient
    return jax.vmap(lambda start: run_episode(scenario, controller, start, duration, limit))(x0)


def run_episode(
    scenario: Scenario, controller: AbstractController[Any], x0: State, duration: float, adjoint_limit: float
) -> Measures:
    """The measures of one episode (s); ``adjoint_limit`` bounds the gradient with respect to each of its states."""
    steps, guard = round(duration / SCORE_RULES.dt), lambda x: bound_adjoint(x, adjoint_limit)
    *_, rows = simulate(scenario, controller, x0, SCORE_RULES.dt, steps, guard=guard)
    return measure_episode(rows, scenario.parameters)


@functools.partial(jax.custom_vjp, nondiff_argnums=(1,))
def bound_adjoint(x: State, limit: float) -> State:
    """The state itself. Backwards, the gradient of all later costs is scaled down to a norm of at most ``limit``.

    A pendulum that turns over is chaotic: gradients through it grow without bound and carry no information.
    """
    return x


def _backwards(limit: float, _: None, gradient: Float[Array, "4"]) -> tuple[Float[Array, "4"]]:
    # A gradient that overflowed has no direction: it is dropped.
    gradient = jnp.nan_to_num(gradient, nan=0.0, posinf=0.0, neginf=0.0)
    # The summand keeps a gradient of 0 from 0 / 0.
    return (gradient * jnp.minimum(1.0, limit / jnp.sqrt(jnp.sum(gradient**2) + 1e-20)),)


bound_adjoint.defvjp(lambda x, limit: (x, None), _backwards)


def with_actor(controller: PolicyController, actor: Actor) -> PolicyController:
    """The controller with this network, whether it has one or was left without."""
    return eqx.tree_at(lambda c: c.policy.actor, controller, actor, is_leaf=lambda leaf: leaf is None)


def single_precision(tree: Any) -> Any:
    """All numbers of a controller, or of a part of it, as arrays in single precision."""
    return jax.tree.map(lambda leaf: jnp.asarray(leaf, jnp.float32) if eqx.is_array_like(leaf) else leaf, tree)
