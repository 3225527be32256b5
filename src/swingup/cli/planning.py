"""The command that plans: ``trajectory``."""

import shlex
from typing import Annotated

from tyro.conf import arg

from ..control.published import PUBLISHED
from ..control.reference import compute_reference, save_reference
from ..errors import SwingupError
from ..files import check_writable
from ..physics.parameters import get_robot
from .arguments import RobotName


def trajectory(robot: RobotName, /, out: Annotated[str, arg(metavar="FILE.npz")], seed: int = 0) -> int:
    """Compute the swing-up that the baselines follow by iterative LQR; takes a minute or two.

    Args:
        robot: the robot.
        out: the trajectory's file.
        seed: seed of the first torques; another one may end in another local optimum.
    """
    chosen = get_robot(robot)
    if not 0 <= seed < 2**31:
        raise SwingupError(f"seed = {seed} is out of range: use 0 to 2³¹ - 1")
    check_writable(out)
    reference, provenance = compute_reference(chosen, PUBLISHED[chosen.name].swingup, seed)
    command = shlex.join(["swingup", "trajectory", robot, "--seed", str(seed), "--out", out])
    save_reference(out, reference, {**provenance, "command": command})
    for name, value in provenance.items():
        print(f"{name:<20}{value}")
    return 0
