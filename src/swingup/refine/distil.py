"""Distillation: one network that sees its plant learns from a teacher for each of many plants.

The rounds are those of DAgger (Ross, Gordon and Bagnell, AISTATS 2011): in the first the teachers act, in the
others mostly the student, and the teachers answer in the visited states. In many runs the student sees the nominal
plant at first and its own only later, as behind an identifier. At the end two gradients are added: of the score of
whole swing-ups of the nominal plant, and of the cost of recoveries. :func:`recover` teaches a policy that sees its
plant by its own torques and these two gradients alone.
"""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Array, Float, Int

from ..areapo.initial import init_actor
from ..areapo.networks import Actor
from ..benchmark.rollout import Scenario
from ..benchmark.runner import StageProgress
from ..common.errors import SwingupError
from ..common.types import Key, Scalar, State
from ..controllers.interface import AbstractController
from ..controllers.stack.policy import Policy, PolicyController, plant_of
from ..controllers.stack.regulator import TRIANGLE, RegulatingController, with_regulator
from ..loop.starts import Starts, sample_starts
from ..plant.base_parameters import BASE, base_parameters
from ..plant.plant import Plant
from ..policy.regulator import Loop, RegulatorSettings, fixed_point
from ..tasks.task import PendulumStage, PlantStage
from .gradient import ADJOINT_LIMIT, EpisodeWeights, run_episode, run_episodes, single_precision, with_actor
from .rollouts import ANYWHERE, Dataset, dagger_rollouts, own_runs, swings_up, uniform_states
from .teachers import GEAR, PlantDraws, TrainingSet, batch_of, draw_key, plants_of

LAYERS = (128, 128, 128)  # widths of the student's hidden layers
CLIP = 3.0  # maximum of a base parameter that the network sees, in its units
LEARNING_RATE, LATER_RATE = 1.5e-3, 0.6
"""Adam's step size in the first round, and its share of it in the others; it falls to 0 on a cosine."""
STUDENT_SHARE = 0.8  # share of the runs in which the student acts, after the first round
FAILING_SHARE = 0.3
"""Share of a round's runs, after the first, on plants that the informed student does not swing up."""
SCORE_RATE = 3e-4  # Adam's maximum step size where the score counts
SCORE_DURATION = 1.8  # length of a scored swing-up (s)
UP_SHARE = 0.1  # share of an episode in which the tip is up, from about which on its score counts
SPREAD = 0.01  # maximum standard deviation of the initial states of the scored swing-ups (rad, rad/s)
PARTS = 40  # calls in which steps are taken; progress is reported between them
REPORT_EVERY = 8  # the student is reported after so many of them
RECOVERY_STARTS = 8192  # states that recoveries begin in


@dataclass(frozen=True)
class ScoredSteps:
    """Steps in which the score of swing-ups and the cost of recoveries count beside the torques' squared errors."""

    steps: int  # Steps of Adam
    weight: float  # Weight of the score, beside the squared errors of the torque (N² m²)
    swingups: int  # Swing-ups of the nominal plant in a step
    recoveries: int  # Recoveries on plants of which the student is informed, in a step
    duration: float  # Length of a recovery (s)
    starts: Starts  # Where recoveries begin
    nominal: float  # Fraction of the thrown starts on the nominal plant; all other recoveries are on any
    weights: EpisodeWeights
    """Weights of the recoveries' measures, beside the squared errors of the torque (N² m²)."""
    batch: tuple[int, int]  # States from anywhere, and states of runs, in a minibatch


@dataclass(frozen=True)
class DistillationStage:
    """A new network learns from teachers; at the end the score counts."""

    draws: PlantDraws
    scored: ScoredSteps
    copies: int = 80  # Copies of the nominal plant beside the drawn ones
    rounds: int = 4  # Rounds of DAgger; in the first the teachers act
    runs: int = 8  # Runs on each plant in a round
    steps: int = 80_000  # Steps of Adam in the first and the last round; half as many in the others


@dataclass(frozen=True)
class RecoveryStage:
    """A policy that sees its plant learns to recover on many plants, and keeps its torques on its own swing-ups."""

    draws: PlantDraws
    scored: ScoredSteps
    runs: int = 3  # Swing-ups of each plant whose torques are kept


class InformedRegulator(RegulatingController):
    """A regulator whose cost-to-go is that of its plant from the first call on, and so need not follow."""

    @property
    def loop(self) -> Loop:
        """What the regulator knows."""
        return super().loop._replace(advanced=lambda P, _: P)


class Recoveries(NamedTuple):
    """What recoveries are drawn from; the last plant is the nominal one."""

    plant: Plant  # leaves of shape (plants,)
    base: Float[Array, "plants 9"]  # base parameters of the plants
    starts: Float[Array, "starts 4"]  # states that recoveries begin in (rad, rad/s)
    on: Int[Array, "starts"]  # the plants that they begin on; -1 for any
    regulators: InformedRegulator | None = None
    """The plants', without the policy: ``start`` has shape (plants, 15). None where the policy is alone."""

    def informed(self, student: PolicyController, index: Int[Array, ""] | int) -> AbstractController[Any]:
        """The student, and the regulator if there is one, informed of one of the plants."""
        student = replace(student, base=self.base[index])
        if self.regulators is None:
            return student
        start = self.regulators.start[index]
        return replace(self.regulators, controller=student, base=student.base, start=start)


class Lesson(eqx.Module):
    """What a student learns from in one run of gradient steps."""

    student: PolicyController  # the steps begin with its network
    dataset: Dataset
    base: Float[Array, "plants 9"]  # base parameters of the dataset's plants
    optimiser: optax.GradientTransformation = eqx.field(static=True)
    batch: tuple[int, int] = eqx.field(static=True)
    """Rows of a minibatch: of states from anywhere, which come first in the dataset, and of runs."""
    anywhere: int = eqx.field(static=True)  # states from anywhere in the dataset
    scored: ScoredSteps | None = eqx.field(static=True, default=None)
    """Steps with a score; None where the torques' squared errors count alone."""
    recoveries: Recoveries | None = None

    def loss(self, actor: Actor, key: Key) -> Scalar:
        """Mean squared error of the torque (N² m²) on a minibatch, less the weighted score, and with recoveries."""
        rows_key, size_key, start_key, recovery_key = jax.random.split(key, 4)
        data, limit = self.dataset, self.student.torque_limit
        first = jnp.array(np.repeat([0, self.anywhere], self.batch))
        count = jnp.array(np.repeat([self.anywhere, len(data.u) - self.anywhere], self.batch))
        rows = first + jax.random.randint(rows_key, first.shape, 0, count)
        seen = jax.vmap(self.student.policy.observe)(data.x[rows], self.base[data.plant[rows]])
        errors = limit * actor.mode(seen.T)[0] - data.u[rows]
        total = jnp.mean(data.weight[rows] * errors**2)
        if self.scored is None or self.recoveries is None:
            return total
        number = self.scored.swingups
        x0 = SPREAD * jax.random.uniform(size_key, (number, 1)) * jax.random.normal(start_key, (number, 4))
        policy = with_actor(eqx.tree_at(lambda c: c.policy.actor, self.student, None), actor)
        total += recovery_cost(policy, self.recoveries, self.scored, recovery_key)
        acting = self.recoveries.informed(policy, -1)
        measures = run_episodes(acting, x0, SCORE_DURATION, plant_of(self.student))
        # As on the board: without a swing-up there is no score. Hanging still would have the best one.
        return total - self.scored.weight * jnp.mean(measures.score * jnp.tanh((1 - measures.down) / UP_SHARE))


def distil(
    training: TrainingSet,
    stage: DistillationStage,
    random: np.random.Generator,
    report: Callable[[PolicyController, int], None] = lambda _, __: None,
    progress: StageProgress = lambda _, __, ___: None,
) -> PolicyController:
    """A policy that sees its plant, from nothing but teachers, for the nominal plant.

    ``report`` is called after each round with the student and the number of rounds so far, and at the end.
    """
    teachers, batch = training.teachers, stage.scored.batch
    student, dataset = new_student(training, random), uniform_states(training, random)
    for number in range(1, stage.rounds + 1):
        which, share = np.arange(teachers.number), 0.0
        if number > 1:
            up, share = swings_up(student, teachers), STUDENT_SHARE
            failing, replaced = np.flatnonzero(~up), random.uniform(size=which.shape) < FAILING_SHARE
            which = np.where(replaced, random.choice(failing, which.shape), which) if len(failing) else which
        runs = dagger_rollouts(training, student, random, stage.runs, share, which)
        dataset = Dataset(*map(np.concatenate, zip(dataset, runs, strict=True)))
        steps = stage.steps if number in (1, stage.rounds) else stage.steps // 2
        rate = LEARNING_RATE * (1.0 if number == 1 else LATER_RATE)
        optimiser = optax.adam(optax.cosine_decay_schedule(rate, steps))
        lesson = Lesson(student, dataset, teachers.base, optimiser, batch, ANYWHERE)
        student = learn(lesson, steps, random, partial(progress, f"lessons {number} of {stage.rounds}"))
        report(student, number)
    recoveries = make_recoveries(
        student, teachers.plant, teachers.base, teachers.cost_to_go[-1], stage.scored, random
    )
    optimiser = scored_optimiser(stage.scored.steps)
    lesson = Lesson(student, dataset, teachers.base, optimiser, batch, ANYWHERE, stage.scored, recoveries)
    student = learn(lesson, stage.scored.steps, random, partial(progress, "score"))
    report(student, stage.rounds + 1)
    return in_numpy(student)


def recover(
    student: PolicyController,
    plants: Plant,
    stage: RecoveryStage,
    random: np.random.Generator,
    regulator: RegulatorSettings,
    report: Callable[[PolicyController, int], None] = lambda _, __: None,
    progress: StageProgress = lambda _, __, ___: None,
) -> PolicyController:
    """A policy that sees its plant, better at recoveries on these plants and on its own; it is its own teacher.

    The plants (leaves of shape (n,)) are in C.1's units, and so is the regulator that acts at the top. Plants that
    no regulator can hold are left out. ``report`` is called as it proceeds, with 0, and at the end, with 1.
    """
    nominal, held, costs = plant_of(student), [], []
    for plant in [*plants_of(plants), nominal]:
        with suppress(SwingupError):
            costs.append(fixed_point(plant, student.robot.joint)[0])
            held.append(plant)
    bases = jnp.float32(np.stack([base_parameters(plant) for plant in held]))
    student, plants = single_precision(student), single_precision(batch_of(held))
    dataset = own_runs(student, plants, bases, random, stage.runs)
    regulators = make_regulators(student, np.stack([P[TRIANGLE] for P in costs]), regulator)
    cost_to_go = jnp.float32(costs[-1][:4, :4])
    recoveries = make_recoveries(student, plants, bases, cost_to_go, stage.scored, random, regulators)
    optimiser = scored_optimiser(stage.scored.steps)
    lesson = Lesson(student, dataset, bases, optimiser, stage.scored.batch, 0, stage.scored, recoveries)
    student = learn(
        lesson, stage.scored.steps, random, partial(progress, "recoveries"), lambda now: report(in_numpy(now), 0)
    )
    report(student, 1)
    return in_numpy(student)


def new_student(training: TrainingSet, random: np.random.Generator) -> PolicyController:
    """A policy with random weights that sees the state and the plant, for the nominal plant."""
    recovery, nominal = training.recovery, plant_of(training.recovery)
    centre = base_parameters(nominal)
    scale = plant_scale(centre, nominal.gr)
    sees = PlantStage(jnp.asarray(centre, jnp.float32), jnp.asarray(scale, jnp.float32), clip=CLIP)
    stages = PendulumStage(angles="sincos"), sees
    actor = init_actor(draw_key(random), stages[0].size() + BASE, 1, LAYERS, 0.0)
    policy = Policy(stages, replace(actor, std_head=None))
    return PolicyController(policy, recovery.torque_limit, recovery.robot, recovery.plant)


def plant_scale(nominal: np.ndarray, gear: float = GEAR) -> np.ndarray:
    """Units of the base parameters (9,) for a network: of the inertial ones shares of the nominal value.

    What a rotor's inertia moves grows with the square of its gear ratio.
    """
    shares = np.append(nominal[:4], np.ones(BASE - 4))
    return shares * np.array([0.15, 0.15, 0.15, 0.15, 0.06, 0.06, 0.12, 0.12, 8e-5 * (GEAR / gear) ** 2])


def learn(
    lesson: Lesson,
    steps: int,
    random: np.random.Generator,
    progress: Callable[[int, int], None],
    report: Callable[[PolicyController], None] = lambda _: None,
) -> PolicyController:
    """The student after gradient steps, a part of them in each compiled call; now and then it is reported."""
    actor = lesson.student.policy.actor
    carry = actor, lesson.optimiser.init(actor)
    keys, part = jax.random.split(draw_key(random), steps), max(1, steps // PARTS)
    lesson = replace(lesson, dataset=jax.tree.map(jnp.asarray, lesson.dataset))
    for number, done in enumerate(range(0, steps, part), start=1):
        progress(done, steps)
        carry = jax.block_until_ready(_take_steps(carry, lesson, keys[done : done + part]))
        if number % REPORT_EVERY == 0:
            report(with_actor(lesson.student, carry[0]))
    progress(steps, steps)
    return with_actor(lesson.student, carry[0])


@jax.jit
def _take_steps(carry: tuple[Actor, optax.OptState], lesson: Lesson, keys: Any) -> tuple[Actor, optax.OptState]:
    def step(carry: Any, key: Key) -> tuple[Any, None]:
        actor, state = carry
        updates, state = lesson.optimiser.update(jax.grad(lesson.loss)(actor, key), state)
        return (optax.apply_updates(actor, updates), state), None

    after: tuple[Actor, optax.OptState] = jax.lax.scan(step, carry, keys)[0]
    return after


def scored_optimiser(steps: int) -> optax.GradientTransformation:
    """Adam where the score counts."""
    schedule = optax.warmup_cosine_decay_schedule(0.0, SCORE_RATE, steps // 8, steps)
    # Gradients through the pendulum are bounded. A drawn plant that is too fast for its time step spoils its batch.
    optimiser = optax.chain(optax.clip_by_global_norm(2.0), optax.adam(schedule))
    return optax.apply_if_finite(optimiser, max_consecutive_errors=steps)


def in_numpy(student: PolicyController) -> PolicyController:
    """The student with its policy in NumPy."""
    return eqx.tree_at(lambda c: c.policy, student, jax.tree.map(np.asarray, student.policy))


def make_regulators(
    student: PolicyController, start: Float[np.ndarray, "plants 15"], settings: RegulatorSettings
) -> InformedRegulator:
    """The regulators of plants with these costs-to-go, upper triangles in C.1's units."""
    made = with_regulator(student, student.robot, plant_of(student), settings, student.torque_limit)
    known = {name: getattr(made, name) for name in ("torque_limit", "geometry", "settings", "scales", "robot")}
    # Without a policy: ``Recoveries.informed`` puts the student in.
    return InformedRegulator(None, made.base, jnp.float32(start), **known)  # type: ignore[arg-type]


def make_recoveries(
    student: PolicyController,
    plant: Plant,
    base: Float[Array, "plants 9"],
    cost_to_go: Float[Array, "4 4"],
    scored: ScoredSteps,
    random: np.random.Generator,
    regulators: InformedRegulator | None = None,
) -> Recoveries:
    """Recoveries on plants with these base parameters; the last, the nominal one, has this LQR's cost-to-go."""
    x0 = sample_starts(random, plant_of(student), scored.starts, RECOVERY_STARTS, np.asarray(cost_to_go, float))
    # The policy sees no full turns, and is not to blame for those that a throw makes.
    x0[:, :2] = np.mod(x0[:, :2] + [0.0, np.pi], 2 * np.pi) - [0.0, np.pi]
    nominal = round(scored.nominal * scored.starts.counts(RECOVERY_STARTS)["thrown"])
    on = np.where(np.arange(RECOVERY_STARTS) < nominal, len(base) - 1, -1)
    return Recoveries(plant, base, jnp.float32(x0), jnp.asarray(on), regulators)


def recovery_cost(student: PolicyController, recoveries: Recoveries, scored: ScoredSteps, key: Key) -> Scalar:
    """Mean cost, with bounded gradients, of an informed student's recoveries, as far as a regulator lets it act."""
    number, weights = scored.recoveries, scored.weights
    plant_key, start_key = jax.random.split(key)
    start = jax.random.randint(start_key, (number,), 0, len(recoveries.starts))
    chosen, on = jax.random.randint(plant_key, (number,), 0, len(recoveries.base)), recoveries.on[start]
    chosen = jnp.where(on < 0, chosen, on)
    # The mean gives each recovery this share of its gradient, which the weight of its time down scales.
    limit = ADJOINT_LIMIT * weights.down / number

    def one(index: Int[Array, ""], start: State) -> Scalar:
        plant = jax.tree.map(lambda leaf: leaf[index], recoveries.plant)
        controller = recoveries.informed(student, index)
        return weights.cost(run_episode(Scenario(plant), controller, start, scored.duration, limit))

    costs = jax.vmap(one)(chosen, recoveries.starts[start])
    # A pendulum that became too fast for its time step teaches nothing.
    return jnp.mean(jnp.where(jnp.isfinite(costs), costs, 0.0))
