"""The command ``refine``: a policy through the stages of a recipe, with progress."""

import time
from functools import partial
from pathlib import Path
from typing import Annotated, Any

from tyro.conf import arg

from ..common.arrays import SUFFIX
from ..common.errors import command_line, duration
from ..learner.run import Run
from ..loop.loop import VALUES
from ..plant.plant import Robot
from ..policy.shipped import AR_EAPO, load_pendulum_policy
from ..refine.adapt import Watch, adapt
from ..refine.recipe import ADAPT, RECIPES, RECOVER, RefinementReport, run_recipe, save_refined
from ..report.log_report import report_adaptation
from ..report.page import PAGE_FORMATS, save_log_report
from . import say_if_interrupted
from .arguments import (
    NO_OPTIONS,
    DomainName,
    FileName,
    PlantOptions,
    RobotName,
    check_outputs,
    plant_of,
    refuse_ignored,
    word_of,
)
from .output import Progress, tell
from .results import result_lines
from .training import train_shown


def refine_command(
    robot: RobotName,
    /,
    out: Annotated[str, arg(metavar="FILE.safetensors")],
    policy: Annotated[str | None, arg(metavar="POLICY")] = None,
    recipe: Annotated[str, word_of("recipe", *RECIPES)] = RECOVER,
    plant: PlantOptions = NO_OPTIONS,
    domain: DomainName | None = None,
    frames: int | None = None,
    seed: int = 0,
    seeds: int | None = None,
    page: FileName | None = None,
) -> int:
    """Refine a trained policy by gradients through the simulation or by teachers, in minutes to an hour.

    The file is rewritten as it proceeds: an interrupted run leaves its latest policy, and Ctrl-C says how to go on.
    adapt then goes on after its last finished stage. What stands around the policy, such as an estimator and a
    guard, is made anew or left out. adapt needs no policy: where the shipped one does not succeed, it trains one
    that recovers, computes swing-ups of plants of a domain, distils them into a network that sees its plant, and
    where that does not succeed either, adds recoveries. The best of these is judged on other draws.

    Args:
        robot: acrobot or pendubot.
        out: the refined policy's file.
        policy: the policy to start from: a file, or the name of a shipped one; default ar-eapo, for adapt one that
            is trained first, in OUT-base, unless the shipped adaptive succeeds on 98 % of the domain's draws.
        recipe: recover (be up again soon after throws; a policy that sees its plant, on any of a domain) or adapt
            (find the plant, and swing up any of a domain).
        plant: what the policy is refined on; for adapt a plant with ranges, or a guess, which is off by 10 %.
        domain: where the policy sees its plant: plants and loops, as of evaluate --board sim2real; default
            recorded.
        frames: for adapt: frames that the policy to start from is trained for.
        seed: seed of all random numbers.
        seeds: for adapt: draws that are judged; default 100.
        page: for adapt: also write a page (.html) of training and judged draws.
    """
    check_outputs([SUFFIX], out)
    check_outputs(PAGE_FORMATS, page)
    if recipe != ADAPT:
        refuse_ignored({"frames": frames, "seeds": seeds, "page": page}, f"is for --recipe {ADAPT}")
    policy = AR_EAPO if policy is None and recipe != ADAPT else policy
    options: dict[str, Any] = {"policy": policy, "recipe": recipe, "domain": domain, "seed": seed}
    options |= {"frames": frames, "seeds": seeds}
    command = command_line("refine", robot.name, **options, out=Path(out).name, **plant)
    base = None if policy is None else load_pendulum_policy(policy, robot)
    on = plant_of(plant)
    if recipe == ADAPT:
        say_if_interrupted(
            f"{out} and files beside it keep what is done: the same command goes on after the last finished stage"
        )
        draws = 100 if seeds is None else seeds
        known = {"policy": base, "frames": frames, "seed": seed, "draws": draws, "command": command}
        return _adapt(robot, out, page, plant=on, domain=domain, **known)
    assert base is not None  # of the default
    with Progress() as bar:

        def report(now: RefinementReport) -> None:
            save_refined(out, now, base, command, seed)
            again = command_line("refine", robot.name, **options | {"policy": out}, out=out, **plant)
            steps = f"{now.iteration} of {now.total} steps"
            say_if_interrupted(f"{out} has the policy after {steps}: go on with {again}")
            _show(bar, now)

        run_recipe(base, recipe, seed, plant=on, domain=domain, report=report, progress=bar)
    # A plant with ranges, or in a loop, is judged in simulations of the robot.
    drawn = domain is not None or (on is not None and (any(map(VALUES.get, on.names)) or not on.knows_plant))
    board = "sim2real" if drawn else None
    again = command_line("evaluate", robot.name, board=board, controller=out, **plant, domain=domain)
    tell(f"wrote {out}: judge it with {again}")
    return 0


def _adapt(robot: Robot, out: str, page: str | None, **options: Any) -> int:
    """Adapt with progress, and report; the exit status is that of the signal that stopped the training, or 0."""
    begun, status = time.monotonic(), 0
    with Progress() as bar:

        def train(run: Run) -> bool:
            nonlocal status
            with bar.paused():
                status = train_shown(run)
            return not status

        def tell_apart(line: str) -> None:
            with bar.paused():
                tell(line)

        found = adapt(robot, out, **options, watch=Watch(train, partial(_show, bar), bar, tell_apart))
    if found is None:
        return status
    if page is not None:
        save_log_report(report_adaptation(found.domain, found.result), page)
    again = command_line("evaluate", robot.name, board="sim2real", controller=out, domain=found.domain.name)
    took = duration(time.monotonic() - begun)
    tell(*result_lines(found.result, out), f"wrote {out} in {took}: judge it on other draws with {again}")
    return 0


def _show(bar: Progress, now: RefinementReport) -> None:
    means = "".join(f"  {name.replace('_', ' ')} {value:.3f}" for name, value in now.measures.items())
    figures = f"score {now.criteria.score:.3f}{means}"
    bar(f"stage {now.stage} of {len(now.stages)}", now.iteration, now.total, figures)
