"""The command ``refine``: a policy through the stages of a recipe, with progress."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

from tyro.conf import arg

from ..benchmark.seeds import check_seeds
from ..common.files import check_writable
from ..common.version import __version__
from ..controllers.stack.controller import policy_alone
from ..policy.pendulum import write_pendulum_policy
from ..policy.shipped import AR_EAPO, GLOBAL, load_policy
from ..refine.recipe import ADAPT, RECIPES, RefinementReport, run_recipe, wrapped_policy
from .arguments import NO_PLANT, PlantOptions, RobotName, optional, plant_of, word_of
from .output import tell
from .parsing import command_line
from .progress import Progress


def refine_command(
    robot: RobotName,
    /,
    out: Annotated[str, arg(metavar="FILE.safetensors")],
    policy: Annotated[str | None, optional("POLICY")] = None,
    recipe: Annotated[str, word_of("recipe", *RECIPES)] = "recover",
    plant: PlantOptions = NO_PLANT,
    seed: int = 0,
) -> int:
    """Refine a trained policy by gradients through the simulation or by teachers, in minutes to an hour.

    The file is rewritten as it proceeds: an interrupted run leaves its latest policy. Between its two stages adapt
    is silent for a few minutes while it optimises the teachers' swing-ups; then it reports each of five rounds.

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
    on = plant_of(plant)
    check_seeds(seed, 1)
    check_writable(out)
    policy = policy or (GLOBAL if recipe == ADAPT else AR_EAPO)
    base, stages = load_policy(policy, robot), RECIPES[recipe]
    command = command_line(
        "refine", robot.name, policy=policy, recipe=recipe, seed=seed, out=Path(out).name, **plant
    )
    with Progress() as progress:

        def report(now: RefinementReport) -> None:
            write_pendulum_policy(
                out, wrapped_policy(now.controller), _provenance(base.metadata, command, seed, stages, now)
            )
            means = "".join(f"  {name.replace('_', ' ')} {value:.3f}" for name, value in now.measures.items())
            figures = f"score {now.criteria.score:.3f}{means}"
            progress(f"stage {now.stage} of {len(stages)}", now.iteration, now.of, figures)

        run_recipe(policy_alone(base), robot, stages, seed, report, plant=on)
    judge = command_line("evaluate", robot.name, controller=out, **plant)
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
    }
