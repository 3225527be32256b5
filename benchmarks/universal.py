"""One network for a family of designs: taught about each of them, judged from each one's nominal parameters.

Usage: python benchmarks/universal.py ROBOT FOLDER [--designs C.1 A.0 cloudpendulum B.0] [--plants 160]
[--steps 60000] [--frames 6000000] [--judged C.1 C.0 A.0 cloudpendulum B.0] [--seeds 40] [--share 0.25]

An experiment (lab/adaptive.md), no recipe of the package. In units of l1, √(l1/g) and the torque limit every
pendulum has C.1's upper link and gravity: its inertial base parameters alone tell it apart. About each design
plants are drawn: masses and inertias are off, the motor is weaker, and a compensation leaves friction. Their
swing-ups are continued from the design's own, and the preset `small` recovers. One student learns from all.
FOLDER keeps recovering policies and swing-ups; what is there is not repeated. The table has the successes of
`seeds` draws about each judged design, masses and inertias within `share`, or less where such draws are no
pendulums, in the loop of `recorded`.
"""

import argparse
import math
import pickle
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax

from swingup.benchmark.judge import judge
from swingup.common.errors import SwingupError
from swingup.controllers.baselines.continuation import continue_swingups, nominal_swingups
from swingup.controllers.baselines.continuation_settings import ContinuationSettings
from swingup.controllers.stack.controller import PolicyController, make_controller, policy_alone
from swingup.learner.policy_files import BEST
from swingup.learner.run_settings import make_run_settings
from swingup.learner.start import resume_run, start_run
from swingup.loop.domain import Domain
from swingup.loop.on_plant import drawn_around, loop_around
from swingup.plant.base_parameters import FRICTIONS
from swingup.plant.plant import LEADERBOARD, Plant, load_plant, validated
from swingup.plant.robots import ROBOTS, Robot
from swingup.plant.units import C1, STATE, Scales, scales_of, similar_plant
from swingup.policy.plant_facts import policy_plant
from swingup.policy.shipped import load_policy
from swingup.refine.analytic_policy_gradient import single_precision
from swingup.refine.dataset import Dataset, dagger_rollouts, swings_up, uniform_states
from swingup.refine.distillation import descend, new_student
from swingup.refine.distillation_settings import DistillationSettings
from swingup.refine.plant_draws import GEAR, RECORDED, behind_motor
from swingup.refine.recipe import first_plant, in_units, wrapped_policy
from swingup.refine.teacher import Teachers, make_teachers
from swingup.tasks.observation import PlantStage

DESIGNS = ("C.1", "A.0", "cloudpendulum", "B.0")
NEAR = {"C.1": ("C.1", "C.1", "C.0")}
"""Designs whose plants are drawn about another one's."""
OFF, WEAKEST, GAIN = 0.26, 0.74, 0.875
"""Largest share by which masses and inertias are off; least gain of a motor, and that of the nominal plant's."""
FRICTION = {"b1": (-0.002, 0.005), "b2": (-0.002, 0.005), "cf1": (-0.02, 0.04), "cf2": (-0.02, 0.04)}
"""Ranges of what the compensation leaves (N m s/rad, N m)."""
COPIES = 20
"""Of each nominal plant, beside the drawn ones."""
ANYWHERE = 15_000
"""States from anywhere, of each design."""
LEAST = np.array([0.005, 0.003, 0.01, 0.01, 0.06, 0.06, 0.12, 0.12, 8e-5])
"""Least units of the base parameters for the network: those of friction and rotors."""
SHARES = (0.2, 0.15, 0.1)
"""Tried where wider draws are no pendulums."""


class School(NamedTuple):
    """The teachers of a design's plants, and the policy that recovers on its nominal one."""

    teachers: Teachers
    recovery: PolicyController


def arm_scales(plant: Plant) -> Scales:
    """Units in which a pendulum has C.1's upper link and gravity."""
    length = plant.l1 / LEADERBOARD.l1
    time = math.sqrt(length * LEADERBOARD.g / plant.g)
    return Scales(time, max(plant.tl1, plant.tl2) / LEADERBOARD.tl1, length)


def in_arm_units(design: str) -> Plant:
    """A design in these units."""
    plant = load_plant(design)
    return similar_plant(plant, arm_scales(plant))


def drawn(random: np.random.Generator, design: str, robot: Robot) -> Plant:
    """A plant about a design."""
    near = NEAR.get(design, (design,))
    plant = in_arm_units(near[random.integers(len(near))])
    off = {name: getattr(plant, name) * random.uniform(1 - OFF, 1 + OFF) for name in ("m1", "m2", "I1", "I2")}
    left = {name: random.uniform(*ends) for name, ends in FRICTION.items()}
    changed = plant.changed(**off, **left, Ir=plant.Ir * random.uniform(0, 2)).driven(robot)
    try:
        return validated(behind_motor(changed, random.uniform(WEAKEST, 1.0)))
    except SwingupError:
        return drawn(random, design, robot)


def school(robot: Robot, design: str, folder: Path, plants: int, frames: int) -> School:
    """A design's teachers and recovering policy, from the folder or made."""
    nominal = behind_motor(in_arm_units(design).frictionless(), GAIN)
    place, file = folder / f"{robot.name}-{design}", folder / f"{robot.name}-{design}.pkl"
    if not file.exists():
        random, own = np.random.default_rng(5), scales_of(nominal)
        draws = [similar_plant(drawn(random, design, robot), own) for _ in range(plants)]
        targets, start = jax.tree.map(lambda *each: np.array(each, float), *draws), similar_plant(nominal, own)
        progress = partial(print, design, flush=True)
        found = continue_swingups(robot, targets, progress=progress, nominal=start)
        copies = nominal_swingups(robot, COPIES, ContinuationSettings(), start)
        kept = jax.tree.map(lambda leaf: leaf[found.reached > 0], found)
        both = jax.tree.map(lambda *parts: np.concatenate(parts), kept, copies)
        states, gains = own.scaled(both.states, *STATE), own.similar(both.gains, *STATE)
        back = similar_plant(both.plants, C1.over(own))
        file.write_bytes(pickle.dumps(replace(both, plants=back, states=states, gains=gains)))
    run = (
        resume_run(place, frames)
        if place.exists()
        else start_run(make_run_settings(robot.name, "small", plant=nominal), place, frames)
    )
    for _ in run.advance():
        pass
    teachers = make_teachers(pickle.loads(file.read_bytes()), nominal.driven(robot))
    gear = np.append(np.ones(8), (nominal.gr / GEAR) ** 2).astype(np.float32)
    teachers = replace(teachers, base=teachers.base * gear, nominal=teachers.nominal * gear)
    return School(teachers, single_precision(policy_alone(load_policy(place / BEST, robot))))


def student_of(
    schools: list[School], settings: DistillationSettings, random: np.random.Generator
) -> PolicyController:
    """The student of all schools, by the rounds of ``distil``."""
    bases = np.concatenate([np.asarray(each.teachers.base) for each in schools])
    first = np.cumsum([0, *(each.teachers.number for each in schools)])
    centre, scale = bases.mean(0), np.maximum(bases.std(0), LEAST)
    centre[FRICTIONS.start :], scale[FRICTIONS.start :] = 0.0, LEAST[FRICTIONS.start :]
    student = new_student(schools[0].recovery, settings, random)
    stage = PlantStage(jnp.asarray(centre, jnp.float32), jnp.asarray(scale, jnp.float32), clip=4.0)
    policy = replace(student.policy, stages=(student.policy.stages[0], stage))
    student = replace(student, policy=policy)
    own = replace(settings, anywhere=ANYWHERE)

    def joined(parts: list[Dataset]) -> Dataset:
        parts = [
            part._replace(plant=(part.plant + at).astype(np.int32)) for part, at in zip(parts, first, strict=False)
        ]
        return sum(parts[1:], parts[0])

    dataset = joined([uniform_states(*each, own, random) for each in schools])
    for number in range(1, settings.rounds + 1):
        parts = []
        for teachers, recovery in schools:
            which, acts = np.arange(teachers.number), 0.0
            if number > 1:
                failing, acts = np.flatnonzero(~swings_up(student, teachers, settings.duration)), settings.own
                replaced = random.uniform(size=which.shape) < settings.failing
                which = np.where(replaced, random.choice(failing, which.shape), which) if len(failing) else which
            parts.append(dagger_rollouts(teachers, recovery, student, settings, random, acts, which))
        dataset += joined(parts)
        steps = settings.steps if number in (1, settings.rounds) else settings.steps // 2
        rate = settings.learning_rate * (1.0 if number == 1 else 0.6)
        optimiser = optax.adam(optax.cosine_decay_schedule(rate, steps))
        key, progress = jax.random.key(int(random.integers(2**31))), partial(print, "lessons", number, flush=True)
        student = descend(student, jnp.asarray(bases), dataset, settings, key, steps, optimiser, progress)
    return student


def widest(design: str, share: float) -> tuple[float, Domain]:
    """Draws about a design in the loop of `recorded`, as wide as they are pendulums."""
    for wide in (share, *(each for each in SHARES if each < share)):
        try:
            return wide, loop_around(drawn_around(design, wide), RECORDED)
        except SwingupError:
            continue
    raise SwingupError(f"draws about {design} are no pendulums: give a smaller --share")


def behind_identifier(student: PolicyController, domain: Domain, robot: Robot) -> Any:
    """The student behind estimator, identifier and regulator, told a domain's nominal plant alone."""
    facts = policy_plant(first_plant(domain, robot), robot)
    own = in_units(student, arm_scales(facts))
    seen, stage = own.policy.stages
    assert isinstance(stage, PlantStage)
    gear = np.append(np.ones(8), (GEAR / facts.gr) ** 2)
    stages = seen, replace(stage, centre=np.asarray(stage.centre) * gear, scale=np.asarray(stage.scale) * gear)
    own = replace(
        own, policy=replace(own.policy, stages=stages), plant=facts, torque_limit=facts.limit(robot.joint)
    )
    return make_controller(wrapped_policy(own, float(domain.high.loop.passive_limit)))


def main() -> None:
    """Teach, judge and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("robot", choices=list(ROBOTS))
    parser.add_argument("folder", type=Path)
    parser.add_argument("--designs", nargs="+", default=list(DESIGNS))
    parser.add_argument("--plants", type=int, default=160)
    parser.add_argument("--steps", type=int, default=60_000)
    parser.add_argument("--frames", type=int, default=6_000_000)
    parser.add_argument("--judged", nargs="+", default=["C.1", "C.0", *DESIGNS[1:]])
    parser.add_argument("--seeds", type=int, default=40)
    parser.add_argument("--share", type=float, default=0.25)
    options = parser.parse_args()
    robot = ROBOTS[options.robot]
    options.folder.mkdir(parents=True, exist_ok=True)
    schools = [school(robot, each, options.folder, options.plants, options.frames) for each in options.designs]
    settings = DistillationSettings(
        anywhere=ANYWHERE * len(schools), steps=options.steps, duration=3.0, score_steps=0
    )
    student = student_of(schools, settings, np.random.default_rng(11))
    for design, (teachers, _) in zip(options.designs, schools, strict=True):
        print(
            f"{design}: {100 * swings_up(student, teachers, 4.0).mean():.0f} % up where it is told its plants",
            flush=True,
        )
    print("| design | draws within | successes |\n|---|---:|---:|")
    for design in options.judged:
        share, domain = widest(design, options.share)
        result = judge(
            behind_identifier(student, domain, robot), robot, "sim2real", options.seeds, seed=70_000, domain=domain
        )
        print(f"| {design} | {100 * share:g} % | {result.successes} of {options.seeds} |", flush=True)


if __name__ == "__main__":
    main()
