"""The recipe ``adapt`` of ``refine``: from a domain to a policy that finds its plant, judged on other draws."""

from functools import partial
from pathlib import Path

from ..benchmark.judge import judge
from ..benchmark.result import Result
from ..common.files import write_atomically
from ..controllers.registry import get_controller
from ..learner.policy_files import BEST
from ..learner.presets import get_preset
from ..learner.run_settings import make_run_settings
from ..learner.start import resume_run, start_run
from ..loop.domain import Domain, load_domain
from ..loop.on_plant import drawn_around, loop_around, plant_as_domain
from ..plant.robots import Robot
from ..policy.pendulum import PendulumPolicy
from ..policy.shipped import load_policy
from ..refine.plant_draws import RECORDED
from ..refine.recipe import frictionless_design
from .arguments import PlantOptions, plant_of
from .progress import Progress
from .showing import figures

PRESET = "small"
"""Preset of the base policies: it learns to recover on any pendulum in minutes."""
SEED = 20_000
"""First seed of the judged draws."""


def adapted_domain(options: PlantOptions, domain: str | None, out: str) -> tuple[Domain, str]:
    """The domain that the options name, and the file that has it: one beside ``out`` around a plant of facts."""
    if "plant" not in options:
        return load_domain(domain or RECORDED), domain or RECORDED
    facts = plant_as_domain(plant_of(options) if options.get("frictionless") else options["plant"])
    if facts.low.plant == facts.high.plant:
        facts = drawn_around(facts.plant)
    around = loop_around(facts, domain or RECORDED)
    file = Path(out).with_name(f"{Path(out).stem}-adapt.yml")
    rows = {name: [low, high] for name, low, high in around.ranges}
    option = {} if around.low.loop.velocities is None else {"velocities": around.low.loop.velocities}
    text = "".join(f"{name}: {value}\n" for name, value in {**rows, **option}.items())
    write_atomically(file, f"# Source: swingup refine --recipe adapt, {around.name}. SI units.\n{text}".encode())
    return load_domain(str(file)), str(file)


def base_policy(
    robot: Robot, domain: Domain, folder: Path, seed: int, frames: int | None, bar: Progress
) -> PendulumPolicy:
    """A policy that recovers on the domain's plant without friction: trained here, or continued from the folder."""
    goal = get_preset(PRESET).frames if frames is None else frames
    settings = make_run_settings(robot.name, PRESET, plant=frictionless_design(domain), seed=seed)
    run = resume_run(folder, goal) if folder.exists() else start_run(settings, folder, goal)
    bar.log(f"base policy ({PRESET}) for {frictionless_design(domain)}: compiling")
    run.compile()
    bar("base policy", run.frames, run.goal)
    for report in run.advance():
        bar("base policy", report.frames, run.goal, figures(report))
    run.close()
    return load_policy(run.folder / BEST, robot)


def judged(out: str, robot: Robot, domain: Domain, seeds: int, bar: Progress) -> Result:
    """How the policy in a file does on draws that its training did not see."""
    progress = partial(bar, "judging")
    controller = get_controller(out, robot)
    return judge(controller, robot, "sim2real", seeds, seed=SEED, name=out, domain=domain, progress=progress)
