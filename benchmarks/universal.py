"""One policy for a family of designs: taught about each of them, judged from each one's nominal parameters.

Usage: python benchmarks/universal.py ROBOT FOLDER [--designs C.1 A.0 cloudpendulum B.0] [--plants 160]
[--steps 100000] [--frames 6000000] [--judged C.1 C.0 A.0 cloudpendulum B.0] [--seeds 40] [--share 0.25]

In the units of policies (``plant/units.py``) every pendulum has C.1's upper link and gravity: its inertial base
parameters alone tell it apart. About each design plants are drawn: masses and inertias are off, the motor is
weaker, and a compensation leaves friction. The preset `small` recovers. One student learns from all designs'
teachers (``refine/distillation.py``). FOLDER gets ROBOT-universal.safetensors, recovering policies and teachers;
what is there of the latter is not repeated. The table has the successes of `seeds` draws about each judged design,
masses and inertias within `share`, or less where such draws are no pendulums, in the loop of `recorded`.
"""

import argparse
import pickle
from dataclasses import asdict
from functools import partial
from pathlib import Path

import jax
import numpy as np

from swingup.benchmark.judge import judge
from swingup.common import __version__
from swingup.common.errors import SwingupError
from swingup.controllers.stack.policy import make_controller, policy_alone
from swingup.learner.run import resume_run, start_run
from swingup.learner.run_folder import BEST
from swingup.learner.run_settings import make_run_settings
from swingup.loop.domain import Domain
from swingup.loop.on_plant import drawn_around, loop_around
from swingup.plant.files import load_plant
from swingup.plant.plant import LEADERBOARD, ROBOTS, Plant, Robot, validated
from swingup.plant.units import arm_scales, similar_plant
from swingup.policy.pendulum import for_plant, write_pendulum_policy
from swingup.policy.shipped import load_policy
from swingup.refine.dataset import swings_up
from swingup.refine.distillation import distil
from swingup.refine.distillation_settings import DistillationSettings
from swingup.refine.plant_draws import RECORDED, behind_motor
from swingup.refine.recipe import first_plant, on_plant, wrapped_policy
from swingup.refine.teacher import School, make_school

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
SHARES = (0.2, 0.15, 0.1)
"""Tried where wider draws are no pendulums."""


def in_arm_units(design: str) -> Plant:
    """A design in the units of policies."""
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
    run = (
        resume_run(place, frames)
        if place.exists()
        else start_run(make_run_settings(robot.name, "small", plant=nominal), place, frames)
    )
    for _ in run.advance():
        pass
    if not file.exists():
        random, recovery = np.random.default_rng(5), policy_alone(load_policy(place / BEST, robot))
        draws = [drawn(random, design, robot) for _ in range(plants)]
        targets = jax.tree.map(lambda *each: np.array(each, float), *draws)
        made = make_school(recovery, targets, COPIES, partial(print, design, flush=True))
        file.write_bytes(pickle.dumps(made))
    found: School = pickle.loads(file.read_bytes())
    return found


def widest(design: str, share: float) -> tuple[float, Domain]:
    """Draws about a design in the loop of `recorded`, as wide as they are pendulums."""
    for wide in (share, *(each for each in SHARES if each < share)):
        try:
            return wide, loop_around(drawn_around(design, wide), RECORDED)
        except SwingupError:
            continue
    raise SwingupError(f"draws about {design} are no pendulums: give a smaller --share")


def main() -> None:
    """Teach, judge and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("robot", choices=list(ROBOTS))
    parser.add_argument("folder", type=Path)
    parser.add_argument("--designs", nargs="+", default=list(DESIGNS))
    parser.add_argument("--plants", type=int, default=160)
    parser.add_argument("--steps", type=int, default=100_000)
    parser.add_argument("--frames", type=int, default=6_000_000)
    parser.add_argument("--judged", nargs="+", default=["C.1", "C.0", *DESIGNS[1:]])
    parser.add_argument("--seeds", type=int, default=40)
    parser.add_argument("--share", type=float, default=0.25)
    options = parser.parse_args()
    robot = ROBOTS[options.robot]
    options.folder.mkdir(parents=True, exist_ok=True)
    schools = [school(robot, each, options.folder, options.plants, options.frames) for each in options.designs]
    settings = DistillationSettings(
        anywhere=ANYWHERE * len(schools),
        steps=options.steps,
        duration=3.0,
        runs=16,
        batch=4096,
        anywhere_batch=512,
        score_steps=0,
    )
    student = distil(schools, settings, np.random.default_rng(11), progress=partial(print, flush=True))
    for design, (teachers, _) in zip(options.designs, schools, strict=True):
        up = 100 * swings_up(student, teachers, 4.0).mean()
        print(f"{design}: {up:.0f} % up where it is told its plants", flush=True)
    policy = wrapped_policy(on_plant(student, LEADERBOARD.driven(robot)))
    provenance = {"version": __version__, "designs": options.designs, "settings": asdict(settings)}
    write_pendulum_policy(options.folder / f"{robot.name}-universal.safetensors", policy, provenance)
    print("| design | draws within | successes |\n|---|---:|---:|")
    for design in options.judged:
        share, domain = widest(design, options.share)
        controller = make_controller(for_plant(policy, first_plant(domain, robot)))
        result = judge(controller, robot, "sim2real", options.seeds, seed=70_000, domain=domain)
        print(f"| {design} | {100 * share:g} % | {result.successes} of {options.seeds} |", flush=True)


if __name__ == "__main__":
    main()
