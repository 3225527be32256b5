"""The command ``refine``: a policy through the stages of a recipe, with progress."""

import dataclasses
import math
import shlex
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

from rich.console import Console
from tyro.conf import arg

from ..benchmark.seeds import check_seeds
from ..common.checks import one_of
from ..common.files import check_writable
from ..common.version import __version__
from ..controllers.stack.controller import policy_alone, save_controller
from ..plant.robots import get_robot
from ..policy.shipped import AR_EAPO, GLOBAL, load_policy
from ..refine.recipe import ADAPT, RECIPES, RefinementReport, run_recipe
from ..refine.wrappers import default_wrappers
from .arguments import NO_PLANT, PlantFlags, RobotName
from .output import SECONDS_BETWEEN_LINES, tell


def refine_command(
    robot: RobotName,
    /,
    out: Annotated[str, arg(metavar="FILE.safetensors")],
    policy: Annotated[str | None, arg(metavar="POLICY")] = None,
    recipe: str = "recover",
    plant: PlantFlags = NO_PLANT,
    seed: int = 0,
) -> int:
    """Refine a trained policy by gradients through the simulation or by teachers, in minutes to an hour.

    The file is rewritten at each line of progress: an interrupted run leaves its latest policy. Between its two
    stages adapt is silent for some minutes, in which swing-ups of many plants are computed; then it reports each of
    its five rounds.

    Args:
        robot: the robot.
        out: the refined policy's file.
        policy: the policy to start from: a file, or the name of a shipped one; default ar-eapo,
            for adapt global.
        recipe: recover (be up again soon after throws) or adapt (from a policy that recovers: see the plant, and
            swing up any of many).
        plant: what the policy is refined on.
        seed: seed of all random numbers.
    """
    chosen, on = get_robot(robot), plant.make()
    one_of("recipe", recipe, RECIPES)
    check_seeds(seed, 1)
    check_writable(out)
    usual = GLOBAL if recipe == ADAPT else AR_EAPO
    policy = usual if policy is None else policy
    base = load_policy(policy, chosen)
    stages, console = RECIPES[recipe], Console(stderr=True)
    options = {"policy": policy, "recipe": recipe, "seed": seed, "out": Path(out).name}
    words = ["swingup", "refine", robot, *(f"--{name}={value}" for name, value in options.items()), *plant.flags]
    shown = -math.inf

    def report(now: RefinementReport) -> None:
        nonlocal shown
        save_controller(out, now.controller, _provenance(base.metadata, shlex.join(words), seed, stages, now))
        if now.iteration == now.of or time.monotonic() - shown >= SECONDS_BETWEEN_LINES:
            shown = time.monotonic()
            console.print(_line(now, len(stages)), soft_wrap=True, highlight=False)

    run_recipe(policy_alone(base), chosen, stages, seed, report, plant=on)
    judge = shlex.join(["swingup", "evaluate", robot, "--controller", out, *plant.flags])
    tell(f"wrote {out}: judge it with {judge}")
    return 0


def _provenance(
    base: Mapping[str, Any], command: str, seed: int, stages: tuple[Any, ...], now: RefinementReport
) -> dict[str, Any]:
    """Where the refined policy comes from, and the base's own origin; it goes with the estimator."""
    origin = {
        name: base[name]
        for name in ("version", "preset", "command", "seed", "frames", "seconds", "scores")
        if name in base
    }
    return {
        "version": __version__,
        "command": command,
        "seed": seed,
        "seconds": round(now.seconds, 1),
        "stages": [{"kind": type(stage).__name__} | dataclasses.asdict(stage) for stage in stages],
        "scores": {"v2": dataclasses.asdict(now.criteria)},
        "base": origin,
        **default_wrappers(now.controller).metadata(),
    }


def _line(now: RefinementReport, stages: int) -> str:
    means = "  ".join(f"{name.replace('_', ' ')} {value:.3f}" for name, value in now.measures.items())
    return (
        f"stage {now.stage}/{stages}  {now.iteration}/{now.of}  {now.seconds:.0f} s  "
        f"score {now.criteria.score:.3f}  {means}"
    )
