"""From a domain to a judged policy that finds its plant: the shipped one where it succeeds, else trained ones."""

import dataclasses
import hashlib
import logging
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np

from ..benchmark.board import Result
from ..benchmark.judge import judge
from ..benchmark.runner import StageProgress
from ..common import __version__
from ..common.arrays import SUFFIX
from ..common.checks import check_seeds, whole_number
from ..common.errors import SwingupError
from ..common.files import check_suffix, check_writable, write_atomically, write_map
from ..controllers.registry import get_controller
from ..learner.presets import get_preset
from ..learner.run import Run, start_or_resume_run
from ..learner.run_folder import BEST
from ..learner.run_settings import make_run_settings
from ..loop.domain import Domain
from ..loop.resolve import resolve
from ..plant.files import save_plant
from ..plant.plant import PlantLike, Robot, get_robot
from ..policy.pendulum import PendulumPolicy, write_pendulum_policy
from ..policy.shipped import ADAPTIVE, load_policy
from .recipe import ADAPT, GUESS, RECORDED, RECOVER, RefinementReport, first_plant, run_recipe, save_refined

_LOGGER = logging.getLogger(__name__)

PRESET = "small"  # preset of the base policies: it learns to recover on any pendulum in minutes
CHOICE_SEED, JUDGED_SEED = 30_000, 20_000
"""Initial seeds of the draws by which a policy is chosen, and of those on which it is judged."""
ENOUGH = 0.98  # share of the former on which a policy has to succeed to make what comes next needless
RECOVERIES = 3  # maximum number of stages of recoveries; the first that does not help is the last


def train_to_goal(run: Run) -> bool:
    """Train without showing anything."""
    for _ in run.advance():
        pass
    run.close()
    return True


@dataclass(frozen=True)
class Watch:
    """What :func:`adapt` calls on its way."""

    train: Callable[[Run], bool] = train_to_goal
    """Trains the base policy to its goal; False where it was stopped before."""
    report: Callable[[RefinementReport], Any] = lambda _: None
    """Called with each report of a recipe."""
    progress: StageProgress = lambda _, __, ___: None
    """Called with what is computed, how much of it is done, and of how much."""
    log: Callable[[str], Any] = _LOGGER.info
    """Called with a line about each policy that was judged."""


class Adaptation(NamedTuple):
    """What :func:`adapt` made."""

    policy: PendulumPolicy
    domain: Domain
    result: Result
    """On the board ``sim2real``, on draws by which nothing was chosen."""


def adapt(
    robot: Robot | str,
    out: str | Path,
    domain: Domain | str | None = None,
    *,
    plant: PlantLike | Domain | None = None,
    policy: PendulumPolicy | None = None,
    frames: int | None = None,
    seed: int = 0,
    draws: int = 100,
    command: str = "swingup.adapt",
    watch: Watch = Watch(),
) -> Adaptation | None:
    """Make a policy that finds its plant and swings up any plant of a domain.

    The shipped ``adaptive`` is judged first, in the units of the domain's plants. Where it does not succeed on 98 %
    of the draws, a policy that recovers is trained, or continued, in the folder OUT-base, and taken through the
    recipe ``adapt``; where that does not suffice either, through up to three stages of recoveries. The best on the
    same draws is kept, and judged on others.

    Args:
        robot: acrobot or pendubot.
        out: the policy's file, rewritten as it proceeds: an interrupted call leaves its latest policy.
        domain: plants and loops, as of the board ``sim2real``: a domain, its name or its file; None for
            ``recorded``.
        plant: a plant, its name or its file, in the loop of the domain; None for the domain's plants. A plant
            without ranges is a guess, which is off by 10 %. OUT-adapt.yml has the domain that follows.
        policy: a policy of one plant that recovers; None for one that is trained first, unless the shipped one
            succeeds.
        frames: frames that it is trained for; None for the preset's.
        seed: seed of all random numbers of training.
        draws: draws by which policies are chosen, and as many others on which the best one is judged.
        command: what the file names as its origin.
        watch: what is called on the way.

    Returns:
        What was made; None where ``watch.train`` stopped.

    Raises:
        SwingupError: there is no such robot, plant or domain, the file cannot be written, or the policy sees its
            plant already.
    """
    robot, out = get_robot(robot), Path(out)
    check_suffix(out, [SUFFIX])
    check_writable(out)
    check_seeds(seed, RECOVERIES)
    seeds = len(check_seeds(JUDGED_SEED, draws))
    if policy is not None and frames is not None:
        raise SwingupError("frames are for the policy that is trained first: leave them out with a policy")
    frames = get_preset(PRESET).frames if frames is None else whole_number("frames", frames, 1)
    if policy is not None and policy.network.plant_stage is not None:
        raise SwingupError(f"the policy sees its plant already: leave it out, or use the recipe {RECOVER}")
    if policy is not None and policy.robot != robot:
        raise SwingupError(f"the policy is for the {policy.robot.name}, not the {robot.name}")
    loop = RECORDED if domain is None else domain
    # A domain that knows its plant is a guess, too.
    given = resolve(plant, loop)
    around = resolve(given, share=GUESS)
    if plant is not None or around != given:
        around = save_domain(out.with_name(f"{out.stem}-adapt.yml"), around, command)
    attempts = _Attempts(robot, out, around, seeds, command, watch)
    shipped = shipped_for(around, robot) if policy is None else None
    if shipped is not None:
        origin = {"version": __version__, "command": command, "base": {"policy": ADAPTIVE}}
        write_pendulum_policy(out, shipped, origin)
        attempts.keep_best(f"{ADAPTIVE} as shipped, in this pendulum's units")
    if not attempts.suffice:
        base = policy or _trained_base(robot, around, out.with_name(f"{out.stem}-base"), frames, seed, watch)
        if base is None:
            return None
        attempts.refine(base, ADAPT, seed)
        attempts.keep_best("trained for them")
    for number in range(RECOVERIES):
        if attempts.suffice:
            break
        attempts.refine(load_policy(str(out), robot), RECOVER, seed + number)
        if not attempts.keep_best("with more recoveries"):
            break
    result = attempts.judged(JUDGED_SEED)
    for recipe, number in ((ADAPT, 0), *((RECOVER, number) for number in range(RECOVERIES))):
        attempts.stage_file(recipe, seed + number).unlink(missing_ok=True)
    return Adaptation(load_policy(str(out), robot), around, result)


@dataclass
class _Attempts:
    # One policy after another in the same file, of which the best so far on the same draws is kept.
    robot: Robot
    out: Path
    domain: Domain
    seeds: int
    command: str
    watch: Watch
    content: bytes = b""
    successes: int = -1

    @property
    def suffice(self) -> bool:
        return self.successes >= ENOUGH * self.seeds

    def refine(self, base: PendulumPolicy, recipe: str, seed: int) -> None:
        """Take a policy through a recipe; what an interrupted call of the same finished is not repeated."""
        kept, stages, before = self.stage_file(recipe, seed), (0, 1), base
        arrays = b"".join(np.asarray(each).tobytes() for each in jax.tree.leaves(dataclasses.asdict(base.network)))
        network = hashlib.sha256(arrays).hexdigest()
        begun = {"domain": str(self.domain), "network": network}
        if kept.exists():
            found = load_policy(str(kept), self.robot)
            if ({"command": self.command} | begun).items() <= found.metadata.items():
                base, stages = found, found.metadata["finished"]

        def report(now: RefinementReport) -> None:
            save_refined(self.out, now, before, self.command, seed)
            if now.iteration == now.total:
                finished = [now.stage, len(now.stages)]
                save_refined(kept, now, before, self.command, seed, **begun, finished=finished)
            self.watch.report(now)

        finished, total = stages
        if finished < total:
            run_recipe(
                base, recipe, seed,
                domain=self.domain, finished=finished, report=report, progress=self.watch.progress,
            )  # fmt: skip
        else:
            write_atomically(self.out, kept.read_bytes())

    def stage_file(self, recipe: str, seed: int) -> Path:
        """Where the policy after a recipe's last finished stage is kept until the adaptation ends."""
        return self.out.with_name(f"{self.out.stem}-{recipe}-{seed}{SUFFIX}")

    def judged(self, seed: int) -> Result:
        name, progress = str(self.out), partial(self.watch.progress, "judging")
        controller, on = get_controller(name, self.robot), self.domain
        return judge(
            controller, self.robot, "sim2real", self.seeds, seed=seed, name=name, domain=on, progress=progress
        )

    def keep_best(self, what: str) -> bool:
        found = self.judged(CHOICE_SEED).successes
        self.watch.log(f"{what}: {found} of {self.seeds} draws")
        if found > self.successes:
            self.content, self.successes = self.out.read_bytes(), found
            return True
        write_atomically(self.out, self.content)
        self.watch.log(f"{self.out} has the one before")
        return False


def _trained_base(
    robot: Robot, domain: Domain, folder: Path, frames: int, seed: int, watch: Watch
) -> PendulumPolicy | None:
    # It recovers on the domain's first plant; its training may have begun in an earlier call.
    settings = make_run_settings(robot.name, PRESET, plant=first_plant(domain, robot), seed=seed)
    run = start_or_resume_run(settings, folder, frames)
    return load_policy(str(folder / BEST), robot) if watch.train(run) else None


def save_domain(path: Path, domain: Domain, source: str) -> Domain:
    """Write a domain to a file, and return it with the file's name. A design that differs has a file beside it."""
    rows = domain.content
    if domain.design != domain.nominal_plant:
        rows["design"] = f"{path.stem}-design.yml"
        save_plant(path.with_name(rows["design"]), domain.design)
    write_map(path, rows, f"Source: {source}, {domain.name}. SI units.")
    return dataclasses.replace(domain, name=str(path))


def shipped_for(domain: Domain, robot: Robot) -> PendulumPolicy | None:
    """The shipped ``adaptive`` in the units of a domain's plants; None where their first is beyond its range."""
    try:
        found = load_policy(ADAPTIVE, robot, first_plant(domain, robot))
    except SwingupError:
        return None
    assert found.identifier is not None  # it finds its plant
    identifier = dataclasses.replace(found.identifier, passive_limit=domain.high.passive_limit(robot))
    return dataclasses.replace(found, identifier=identifier)
