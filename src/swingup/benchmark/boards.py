"""The registry of boards: each name's rules as data, with their source."""

import dataclasses
import math

from ..common.checks import one_of
from ..common.errors import SwingupError
from ..loop.supervisors import ROBOT_THROW, ROBOT_THROWER, CellSettings, Limits
from .board import AbstractBoard
from .disturbances import PushRules
from .robustness_board import RobustnessBoard
from .swing_up_board import Normalisers, SwingUpBoard
from .uptime_board import UptimeBoard

PERFORMANCE = SwingUpBoard(name="performance", normalisers=Normalisers(20.0, 60.0, 20.0, 0.1, 400.0), perfect=True)
"""The simulation leaderboard of IROS 2024."""

HARDWARE = SwingUpBoard(name="hardware", normalisers=Normalisers(20.0, 60.0, 100.0, 4.0, 400.0))
"""The normalisers of that year's real robot, on the simulation's plant."""

ROBUSTNESS = RobustnessBoard(name="robustness")  # The robustness leaderboard of IROS 2024

UPTIME = UptimeBoard(name="uptime", perfect=True)  # The global-policy leaderboard of ICRA 2025 in simulation

ROBOT_LIMITS = Limits(angle=4 * math.pi, speed=20.0)
"""Beyond these the real robot stops. Source: the AI Olympics' loop on the robot."""

SIM2REAL = SwingUpBoard(
    name="sim2real",
    normalisers=HARDWARE.normalisers,
    limits=ROBOT_LIMITS,
    hold=2.0,  # chosen
    domain="recorded",
    runs=100,
)
"""Swing-ups in a loop like the real robot's that never exceed the robot's limits; ours."""

IROS_REAL = SwingUpBoard(
    name="iros-real",
    normalisers=HARDWARE.normalisers,
    limits=ROBOT_LIMITS,
    stops=True,
    domain="recorded",
    runs=10,
    pushes={
        "acrobot": PushRules(profiles=10, pushes=2, amplitude=(0.5, 0.75)),
        "pendubot": PushRules(profiles=10, pushes=2, amplitude=(0.2, 0.5)),
    },
)
"""The real robot of IROS 2024, simulated, with pushes: what the robot records is scored."""

ICRA_REAL = UptimeBoard(
    name="icra-real",
    throws=10,
    first_throw=60.0 / 11,
    throw_duration=ROBOT_THROW,
    thrower=ROBOT_THROWER,
    limits=Limits(angle=3.5 * math.pi, speed=20.0),
    goals=101,
    stop=Limits(angle=4 * math.pi, speed=25.0),
    domain="recorded",
    runs=3,
)
"""The real robot of ICRA 2025, simulated."""

BOARDS: dict[str, AbstractBoard] = {
    board.name: board
    for board in (
        PERFORMANCE,
        ROBUSTNESS,
        UPTIME,
        HARDWARE,
        # The real robot's board of runs with pushes, whose normalisers differ by robot.
        SwingUpBoard(
            name="hardware-perturbed",
            normalisers=HARDWARE.normalisers,
            for_robots={"acrobot": Normalisers(20.0, 60.0, 20.0, 1.0, 400.0)},
        ),
        SIM2REAL,
        IROS_REAL,
        SwingUpBoard(name="balance", normalisers=HARDWARE.normalisers, lean=0.2, hold=9.0, runs=20),
        # The same robot's board without pushes.
        dataclasses.replace(IROS_REAL, name="v2-real", pushes={}),
        ICRA_REAL,
        # Four drawn cells of CloudPendulum.
        UptimeBoard(
            name="cloudpendulum",
            duration=30.0,
            cell=CellSettings(),
            stop=Limits(angle=math.inf, speed=50.0),
            domain="cells",
            runs=4,
            note="Ours, in the shape of CloudPendulum's public example; official scores are not public.",
        ),
    )
}


def get_board(board: AbstractBoard | str) -> AbstractBoard:
    """Look a board up by its name; a board is returned as it is."""
    return board if isinstance(board, AbstractBoard) else BOARDS[one_of("board", board, BOARDS)]


def swing_up_board(board: AbstractBoard | str) -> SwingUpBoard:
    """Look a board of swing-ups up, for callers that need its criteria."""
    found = get_board(board)
    if not isinstance(found, SwingUpBoard):
        raise SwingupError(f"the board {found.name} does not score single swing-ups: use performance or hardware")
    return found
