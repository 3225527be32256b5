"""The command ``rehearse``: an exported folder drives the simulated robot before it drives the real one."""

from collections.abc import Mapping
from functools import partial
from typing import Annotated

from tyro.conf import Positional, arg

from ..benchmark.boards import SIM2REAL, swing_up_board
from ..benchmark.trajectory_file import save_trajectory
from ..common.checks import positive_number
from ..common.files import check_writable
from ..rehearsal.process import CALLING_TIME
from ..rehearsal.rehearse import rehearse
from ..rehearsal.result import Rehearsal, spread
from .arguments import OptionalDomain, OptionalFile, OptionalRobot
from .output import aligned, tell, tell_json
from .progress import Progress
from .results import result_lines


def rehearse_command(
    folder: Positional[Annotated[str, arg(metavar="FOLDER")]],
    /,
    plant: Annotated[str | None, arg(metavar="PLANT")] = None,
    domain: OptionalDomain = None,
    robot: OptionalRobot = None,
    board: str = SIM2REAL.name,
    duration: float | None = None,
    seed: int = 0,
    seeds: int | None = None,
    real_time: bool = False,
    timeout: float = CALLING_TIME,
    json: bool = False,
    save: OptionalFile = None,
) -> int:
    """Run an exported folder in processes of its own, against simulated robots, before the real one.

    The folder is one of swingup export --to realaigym or cloudpendulum, and is called as there. A folder that
    cannot be imported, crashes, hangs, prints, or gives no two finite torques ends it in one line and status 2.

    Args:
        folder: the folder, or its con_NAME.py or controller_NAME.py.
        plant: a plant's name or its file, with the loop that the file has.
        domain: the loop, and the plant if none is given: a domain's name or file, or none for a perfect loop;
            default: that of the board sim2real, recorded.
        robot: acrobot or pendubot, where the folder does not say it.
        board: how the runs are scored: sim2real, performance, hardware or hardware-perturbed.
        duration: length of a run (s); default: that of the board, 10 s.
        seed: first seed of plants, loops and noise, as of evaluate.
        seeds: seeds in a row; by default 10, or 1 in real time or in a perfect loop.
        real_time: one step every 2 ms, with periods and missed deadlines measured.
        timeout: longest time of a call (s).
        json: print one JSON object.
        save: also write the first run's trajectory to this CSV file.
    """
    scored = swing_up_board(board)
    longest = positive_number("timeout", timeout, 600.0, "s")
    if save is not None:
        check_writable(save)
    with Progress() as bar:
        progress = partial(bar, "runs")
        found = rehearse(folder, plant, domain, robot, scored, duration, seeds, seed, real_time, longest, progress)
    if save is not None and found.result.trajectory is not None:
        save_trajectory(save, found.result.trajectory)
    if json:
        tell_json(found.as_dict())
    else:
        tell(*rehearsal_lines(found))
    return 0


def rehearsal_lines(found: Rehearsal) -> list[str]:
    """How the runs went, what the guard did, and what was measured of the calls."""
    stopped, runs = sum(stop is not None for stop in found.stops), len(found.stops)
    guard = "none" if not found.facts["guard"] else f"stopped {stopped} of {runs}" if stopped else "quiet"
    limits = "" if found.limits is None else "limits {:.4g} rad, {:.4g} rad/s".format(*found.limits)
    rows = [("Call [ms]", spread(found.calls)), ("Period [ms]", spread(found.periods) if found.real_time else {})]
    calls = f"of {len(found.calls)} calls"
    return [
        *result_lines(found.result, f"{found.folder.entry.name}, {found.folder.form}"),
        aligned("Guard", guard, limits),
        *(aligned(title, *_spread(row)) for title, row in rows if row),
        *([aligned("Missed deadlines", str(found.missed), calls)] if found.real_time else []),
        *(
            [f"  The simulation itself was late {found.late} times: close other programs and repeat."]
            if found.late
            else []
        ),
        *([] if found.difference is None else [f"  {found.difference}"]),
    ]


def _spread(row: Mapping[str, float]) -> tuple[str, str]:
    """The median of times in ms, and further of their quantiles."""
    return f"{1e3 * row['p50']:.3f}", f"99 % {1e3 * row['p99']:.3f}, longest {1e3 * row['longest']:.3f}"
