"""The command ``rehearse``: an exported folder drives the simulated robot before it drives the real one."""

from collections.abc import Mapping
from typing import Annotated

from tyro.conf import Positional, arg

from ..benchmark.boards import swing_up_board
from ..benchmark.columns import COLUMNS, PERFORMANCE
from ..benchmark.trajectory_file import save_trajectory
from ..common.checks import positive_number
from ..common.files import check_writable
from ..rehearsal.process import CALLING
from ..rehearsal.rehearse import RECORDED, rehearse
from ..rehearsal.result import Rehearsal, spread
from .arguments import OptionalFile, OptionalFloat, OptionalRobot, optional
from .output import aligned, tell, tell_json


def rehearse_command(
    folder: Positional[Annotated[str, arg(metavar="FOLDER")]],
    /,
    plant: Annotated[str | None, optional("PLANT")] = None,
    domain: Annotated[str, arg(metavar="DOMAIN")] = RECORDED,
    robot: OptionalRobot = None,
    board: str = "hardware",
    duration: OptionalFloat = None,
    seed: int = 0,
    real_time: bool = False,
    timeout: float = CALLING,
    json: bool = False,
    save: OptionalFile = None,
) -> int:
    """Run an exported folder in a process of its own, against the simulated robot, before the real one.

    The folder is one of swingup export --to realaigym or cloudpendulum, and is called as there. A folder that
    cannot be imported, crashes, hangs, prints, or gives no two finite torques ends it in one line and status 2.

    Args:
        folder: the folder, or its con_NAME.py or controller_NAME.py.
        plant: a plant's name or its file, with the loop that the file has.
        domain: the loop, and the plant if none is given: a domain's name or file, or none for a perfect loop.
        robot: acrobot or pendubot, where the folder does not say it.
        board: how the run is scored: performance, hardware or hardware-perturbed.
        duration: length of the run (s); default: that of the board, 10 s.
        seed: seed of noise and plants.
        real_time: one step every 2 ms, with periods and missed deadlines measured.
        timeout: longest time of a call (s).
        json: print one JSON object.
        save: also write the trajectory to this CSV file.
    """
    scored = swing_up_board(board)
    longest = positive_number("timeout", timeout, 600.0, "s")
    if save is not None:
        check_writable(save)
    around = None if domain == "none" else domain
    result = rehearse(folder, plant, around, robot, scored, duration, seed, real_time, longest)
    if save is not None:
        save_trajectory(save, result.trajectory)
    if json:
        tell_json(result.as_dict())
    else:
        tell(*rehearsal_lines(result, board))
    return 0


def rehearsal_lines(result: Rehearsal, board: str) -> list[str]:
    """How the run went, what the guard did, and what was measured of the calls."""
    values, (angle, speed) = {**vars(result.criteria), "score": result.score}, result.limits
    stopped = result.facts["stopped"]
    guard = ("stopped it" if stopped else "quiet") if result.facts["guard"] else "none"
    beyond = "" if result.violation is None else f"at t = {result.violation:.3f} s, where the robot stops"
    timing, late = result.timing, result.timing.late
    rows = [
        ("Call [ms]", spread(timing.calls)),
        ("Period [ms]", spread(timing.periods) if result.real_time else {}),
    ]
    return [
        f"{result.robot}, {result.folder.entry.name} ({result.folder.form}, {result.domain.name}, board {board}, "
        f"seed {result.seed})",
        aligned("Swing-up", "success" if result.success else "failure", result.tip.failure or ""),
        *(aligned(COLUMNS[name].title, COLUMNS[name].show(values[name])) for name in PERFORMANCE),
        aligned("Highest tip [m]", f"{result.tip.highest:.3f}", f"{result.tip.percent:.1f} % of l1 + l2"),
        aligned("Largest speed [rad/s]", f"{result.speed:.1f}", f"limit {speed:g}"),
        aligned("Largest angle [rad]", f"{result.angle:.1f}", f"limit {angle:.4g}"),
        *([aligned("Limits", "passed", beyond)] if beyond else []),
        aligned("Guard", guard, stopped["why"] if stopped else ""),
        *(aligned(title, *_spread(row)) for title, row in rows if row),
        *(
            [aligned("Missed deadlines", str(timing.missed), f"of {len(timing.calls)} calls")]
            if result.real_time
            else []
        ),
        *([f"  The simulation itself was late {late} times: close other programs and repeat."] if late else []),
        *([] if result.difference is None else [f"  {result.difference}"]),
    ]


def _spread(row: Mapping[str, float]) -> tuple[str, str]:
    """The median of times in ms, and further of their quantiles."""
    return f"{1e3 * row['p50']:.3f}", f"99 % {1e3 * row['p99']:.3f}, longest {1e3 * row['longest']:.3f}"
