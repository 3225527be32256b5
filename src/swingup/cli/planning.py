"""The command that plans: ``trajectory``."""

from typing import Annotated

from tyro.conf import arg

from ..benchmark.seeds import check_seeds
from ..common.files import check_writable
from ..controllers.baselines.baselines import design_of
from ..controllers.baselines.own_units import in_real_units
from ..controllers.swingups.reference import save_reference
from ..controllers.swingups.trajectory_csv import save_reference_csv
from ..policy.plant_facts import write_plant
from .arguments import NO_PLANT, PlantOptions, RobotName, plant_of, word_of
from .output import tell
from .parsing import command_line


def trajectory_command(
    robot: RobotName,
    /,
    out: Annotated[str, arg(metavar="FILE.safetensors")],
    plant: PlantOptions = NO_PLANT,
    problem: Annotated[str, word_of("problem", "published", "score")] = "published",
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
    on = plant_of(plant)
    design = design_of(robot, on)
    check_seeds(seed, 1)
    check_writable(out)
    reference, provenance = design.compute(problem, seed)
    reference = reference if design.shipped else in_real_units(reference, design.scales)
    command = command_line("trajectory", robot.name, problem=problem, **plant, seed=seed, out=out)
    if out.endswith(".csv"):
        save_reference_csv(out, reference)
    else:
        about = {"plant": write_plant(on.driven(robot)), "command": command}
        save_reference(out, reference, provenance | about)
    tell(*(f"{name:<20}{value}" for name, value in (provenance | on.summary(robot)).items()))
    return 0
