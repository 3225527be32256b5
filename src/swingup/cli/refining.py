"""The command ``refine``: a policy through the stages of a recipe, with progress."""

import dataclasses
import time
from functools import partial
from pathlib import Path
from typing import Annotated, Any

from tyro.conf import arg

from ..benchmark.judge import judge
from ..benchmark.result import Result
from ..common import __version__
from ..common.arrays import SUFFIX
from ..common.checks import check_seeds, whole_number
from ..common.errors import SwingupError, command_line, duration
from ..common.files import write_atomically, write_map
from ..controllers.registry import get_controller
from ..controllers.stack.policy import policy_alone
from ..learner.presets import get_preset
from ..learner.run import Run, resume_run
from ..learner.run_folder import BEST
from ..loop.domain import Domain, load_domain
from ..loop.on_plant import drawn_around, loop_around, plant_as_domain
from ..plant.plant import LEADERBOARD, Plant, Robot
from ..policy.pendulum import PendulumPolicy, write_pendulum_policy
from ..policy.shipped import ADAPTIVE, AR_EAPO, load_policy
from ..refine.plant_draws import RECORDED
from ..refine.recipe import (
    ADAPT,
    RECIPES,
    RECOVER,
    RefinementReport,
    first_plant,
    run_recipe,
    shipped_for,
    stages_of,
    wrapped_policy,
)
from ..report.log_report import report_adaptation
from ..report.page import PAGE_FORMATS, save_log_report
from .arguments import NO_OPTIONS, DomainName, FileName, PlantOptions, RobotName, check_outputs, plant_of, word_of
from .output import Progress, tell
from .results import result_lines
from .training import start_training, train_shown

PRESET = "small"
"""Preset of the base policies: it learns to recover on any pendulum in minutes."""
CHOICE, SEED = 30_000, 20_000
"""First seeds of the draws by which a policy is chosen, and of those on which it is judged."""
ENOUGH = 0.98
"""Share of the former on which a policy has to succeed to make what comes next needless."""
RECOVERIES = 3
"""Most stages of recoveries; one that does not help is the last."""


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

    The file is rewritten as it proceeds: an interrupted run leaves its latest policy. adapt needs no policy: where
    the shipped one does not do, it trains one that recovers, computes swing-ups of plants of a domain, distils them
    into a network that sees its plant, and where that does not do either, adds recoveries. The best of these is
    judged on other draws.

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
    check_seeds(seed, 1)
    check_outputs([SUFFIX], out)
    check_outputs(PAGE_FORMATS, page)
    for name, value in {"frames": frames, "seeds": seeds, "page": page}.items():
        if recipe != ADAPT and value is not None:
            raise SwingupError(f"--{name} is for --recipe {ADAPT}: leave it out")
    frames = None if frames is None else whole_number("frames", frames, 1)
    number = len(check_seeds(SEED, 100 if seeds is None else seeds))
    policy = AR_EAPO if policy is None and recipe != ADAPT else policy
    options: dict[str, Any] = {"policy": policy, "recipe": recipe, "domain": domain, "seed": seed}
    command = command_line("refine", robot.name, **options, out=Path(out).name, **plant)
    if recipe == ADAPT:
        return _adapt(robot, out, policy, command, plant, domain, frames, seed, number, page)
    given, on = load_policy(str(policy), robot), plant_of(plant)
    sees_plant = policy_alone(given).policy.sees_plant
    if domain is not None and not sees_plant:
        raise SwingupError(f"--domain {domain} is for a policy that sees its plant: give a plant alone")
    drawn = load_domain(domain or RECORDED) if sees_plant else None
    _refine(given, out, recipe, seed, command, plant=on, domain=drawn)
    tell(f"wrote {out}: judge it with {command_line('evaluate', robot.name, controller=out, **plant)}")
    return 0


def _adapt(
    robot: Robot,
    out: str,
    policy: str | None,
    command: str,
    plant: PlantOptions,
    domain: str | None,
    frames: int | None,
    seed: int,
    seeds: int,
    page: str | None,
) -> int:
    """The recipe ``adapt``: the shipped policy where it does, else the best of what is trained."""
    if policy is not None and policy_alone(load_policy(policy, robot)).policy.sees_plant:
        raise SwingupError(f"{policy} sees its plant already: leave --policy out, or use --recipe {RECOVER}")
    begun, (around, file) = time.monotonic(), adapted_domain(plant, domain, out)
    shipped = shipped_for(around, robot) if policy is None else None
    best, kept = b"", -1

    def choose(what: str) -> bool:
        """Keep the file's policy if it is the best so far on these draws, or else the one before it."""
        nonlocal best, kept
        found = _judged(robot, out, around, CHOICE, seeds).successes
        tell(f"{what}: {found} of {seeds} draws")
        if found > kept:
            best, kept = Path(out).read_bytes(), found
            return True
        write_atomically(out, best)
        tell(f"{out} has the one before")
        return False

    if shipped is not None:
        origin = {"version": __version__, "command": command, "base": {"policy": ADAPTIVE}}
        write_pendulum_policy(out, shipped, origin)
        choose(f"{ADAPTIVE} as shipped, in this pendulum's units")
    if kept < ENOUGH * seeds:
        base = policy
        if base is None:
            run = _base_run(robot, around, Path(out), frames, seed)
            if stopped := train_shown(run):
                return stopped
            base = str(run.folder / BEST)
        _refine(load_policy(base, robot), out, ADAPT, seed, command, domain=around)
        choose("trained for them")
    for number in range(RECOVERIES):
        if kept >= ENOUGH * seeds:
            break
        _refine(load_policy(out, robot), out, RECOVER, seed + number, command, domain=around)
        if not choose("with more recoveries"):
            break
    result = _judged(robot, out, around, SEED, seeds)
    if page is not None:
        save_log_report(report_adaptation(around, result), page)
    again = command_line("evaluate", robot.name, board="sim2real", controller=out, domain=file)
    tell(
        *result_lines(result, out),
        f"wrote {out} in {duration(time.monotonic() - begun)}: judge it on other draws with {again}",
    )
    return 0


def _base_run(robot: Robot, domain: Domain, out: Path, frames: int | None, seed: int) -> Run:
    """The training, begun here or in an earlier call, of a policy that recovers on the domain's first plant."""
    folder = out.with_name(f"{out.stem}-base")
    if folder.exists():
        return resume_run(folder, get_preset(PRESET).frames if frames is None else frames)
    plant = first_plant(domain, robot)
    return start_training(robot.name, frames, str(folder), preset=PRESET, plant=plant, seed=seed)


def _judged(robot: Robot, out: str, domain: Domain, seed: int, seeds: int) -> Result:
    """A policy's file on draws of a domain."""
    with Progress() as progress:
        told = partial(progress, "judging")
        controller = get_controller(out, robot)
        return judge(controller, robot, "sim2real", seeds, seed=seed, name=out, domain=domain, progress=told)


def _refine(
    base: PendulumPolicy,
    out: str,
    recipe: str,
    seed: int,
    command: str,
    plant: Plant = LEADERBOARD,
    domain: Domain | None = None,
) -> None:
    """Take a policy through a recipe with a progress bar, and rewrite the file as it proceeds."""
    controller = policy_alone(base)
    stages = stages_of(recipe, controller)
    passive_limit = None if domain is None else float(domain.high.loop.passive_limit)
    kept = ("version", "preset", "command", "seed", "frames", "seconds", "scores")
    origin = {name: base.metadata[name] for name in kept if name in base.metadata}

    def report(now: RefinementReport) -> None:
        metadata = {
            "version": __version__,
            "command": command,
            "seed": seed,
            "seconds": round(now.seconds, 1),
            "stages": [{"kind": type(stage).__name__} | dataclasses.asdict(stage) for stage in stages],
            "scores": {"v2": dataclasses.asdict(now.criteria)},
            "base": origin,
        }
        write_pendulum_policy(out, wrapped_policy(now.controller, passive_limit), metadata)
        means = "".join(f"  {name.replace('_', ' ')} {value:.3f}" for name, value in now.measures.items())
        figures = f"score {now.criteria.score:.3f}{means}"
        bar(f"stage {now.stage} of {len(stages)}", now.iteration, now.of, figures)

    def progress(what: str, done: int, total: int) -> None:
        bar(f"stage {len(stages)} of {len(stages)}, {what}", done, total)

    with Progress() as bar:
        run_recipe(controller, base.robot, stages, seed, report, plant=plant, domain=domain, progress=progress)


def adapted_domain(options: PlantOptions, domain: str | None, out: str) -> tuple[Domain, str]:
    """The domain that the options name, and the file that has it: one beside ``out`` around a plant of facts."""
    if "plant" not in options:
        return load_domain(domain or RECORDED), domain or RECORDED
    facts = plant_as_domain(plant_of(options) if options.get("frictionless") else options["plant"])
    if facts.low.plant == facts.high.plant:
        facts = drawn_around(facts.plant)
    around = loop_around(facts, domain or RECORDED)
    file = Path(out).with_name(f"{Path(out).stem}-adapt.yml")
    rows: dict[str, Any] = {name: [low, high] for name, low, high in around.ranges}
    rows |= {} if around.low.loop.velocities is None else {"velocities": around.low.loop.velocities}
    write_map(file, rows, f"Source: swingup refine --recipe adapt, {around.name}. SI units.")
    return load_domain(str(file)), str(file)
