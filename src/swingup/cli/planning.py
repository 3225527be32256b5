"""The command that plans: ``trajectory``."""

import shlex
from typing import Annotated, Literal

from tyro.conf import arg

from ..benchmark.seeds import check_seeds
from ..common.files import check_writable
from ..controllers.baselines.baselines import design_of
from ..controllers.baselines.own_units import in_real_units
from ..controllers.swingups.reference import save_reference
from ..controllers.swingups.trajectory_csv import save_reference_csv
from ..plant.robots import get_robot
from ..policy.plant_facts import write_plant
from .arguments import NO_PLANT, PlantFlags, RobotName


def trajectory(
    robot: RobotName,
    /,
    out: Annotated[str, arg(metavar="FILE.safetensors")],
    plant: PlantFlags = NO_PLANT,
    problem: Literal["published", "score"] = "published",
    seed: int = 0,
) -> int:
    """Compute the swing-up that the baselines follow by iterative LQR; takes minutes.

    Args:
        robot: the robot.
        out: the trajectory's file; one that ends in .csv is in RealAIGym's format.
        plant: what swings up; for another plant than the leaderboards' the problem is in its own units.
        problem: the published one, or ours: nearly the best RealAI score, which tvlqr-score follows.
        seed: seed of the first torques; another one may end in another local optimum.
    """
    chosen, on = get_robot(robot), plant.make()
    design = design_of(chosen, on)
    check_seeds(seed, 1)
    check_writable(out)
    reference, provenance = design.compute(problem, seed)
    reference = reference if design.shipped else in_real_units(reference, design.scales)
    choice = [] if problem == "published" else ["--problem", problem]
    command = shlex.join(["swingup", "trajectory", robot, *choice, *plant.flags, "--seed", str(seed), "--out", out])
    if out.endswith(".csv"):
        save_reference_csv(out, reference)
    else:
        about = {"plant": write_plant(on.driven(chosen)), "command": command}
        save_reference(out, reference, provenance | about)
    for name, value in (provenance | on.summary(chosen)).items():
        print(f"{name:<20}{value}")
    return 0
