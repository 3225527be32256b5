"""The command that plans: ``trajectory``."""

import shlex
from typing import Annotated, Literal

from tyro.conf import arg

from ..benchmark.seeds import check_seeds
from ..control.optimal import OPTIMAL, compute_optimal_reference
from ..control.published import PUBLISHED
from ..control.reference import compute_reference, save_reference
from ..control.trajectory_csv import save_reference_csv
from ..files import check_writable
from ..physics.parameters import get_robot
from .arguments import RobotName


def trajectory(
    robot: RobotName,
    /,
    out: Annotated[str, arg(metavar="FILE.npz")],
    problem: Literal["published", "score"] = "published",
    seed: int = 0,
) -> int:
    """Compute the swing-up that the baselines follow by iterative LQR; takes a minute or two.

    Args:
        robot: the robot.
        out: the trajectory's file; one that ends in .csv is in RealAIGym's format.
        problem: the published one, or ours: nearly the best RealAI score, which tvlqr-score follows.
        seed: seed of the first torques; another one may end in another local optimum.
    """
    chosen = get_robot(robot)
    check_seeds(seed, 1)
    check_writable(out)
    if problem == "score":
        reference, provenance = compute_optimal_reference(chosen, OPTIMAL[chosen.name].swingup, seed)
    else:
        reference, provenance = compute_reference(chosen, PUBLISHED[chosen.name].swingup, seed)
    choice = [] if problem == "published" else ["--problem", problem]
    command = shlex.join(["swingup", "trajectory", robot, *choice, "--seed", str(seed), "--out", out])
    if out.endswith(".csv"):
        save_reference_csv(out, reference)
    else:
        save_reference(out, reference, {**provenance, "command": command})
    for name, value in provenance.items():
        print(f"{name:<20}{value}")
    return 0
