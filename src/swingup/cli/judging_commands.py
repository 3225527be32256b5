"""The commands that judge a controller: evaluate, robustness, uptime and sim2real."""

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from tyro.conf import OmitArgPrefixes

from ..benchmark import robustness as robustness_of
from ..benchmark import uptime as uptime_of
from ..benchmark.board_rules import BOARD_RULES, BoardRules
from ..benchmark.grid import change_grid
from ..benchmark.robustness import Robustness
from ..benchmark.rules import CRITERIA
from ..benchmark.runner import Progress
from ..benchmark.uptime import Uptime
from ..common.checks import one_of
from ..controllers.registry import Controller
from ..loop.on_plant import loop_around
from ..plant.robots import Robot
from ..policy.shipped import DEFAULT
from .arguments import (
    NO_PLANT,
    ControllerName,
    DisturbanceOptions,
    DomainOrNone,
    EstimatorFlags,
    PlantFlags,
    RobotName,
    split_commas,
)
from .judging import (
    AS_IT_COMES,
    NO_DISTURBANCE,
    Output,
    judge_and_tell,
    judge_performance,
    judge_sim2real,
    judge_trials,
)
from .results import robustness_lines, uptime_lines

SUCCESS = "sim2real"
"""Rules of the command of that name, which no board has."""


@dataclass(frozen=True)
class JudgingCommands:
    """The commands, with the rules as data: a test may shorten them."""

    rules: Mapping[str, BoardRules] = field(default_factory=lambda: BOARD_RULES)

    def evaluate(
        self,
        robot: RobotName,
        /,
        controller: ControllerName = DEFAULT,
        estimator: EstimatorFlags = AS_IT_COMES,
        plant: PlantFlags = NO_PLANT,
        rules: str = "v2",
        json: bool = False,
        save: str | None = None,
        disturbance: OmitArgPrefixes[DisturbanceOptions] = NO_DISTURBANCE,
    ) -> int:
        """Simulate one swing-up by the benchmark's rules and score it.

        Args:
            robot: the robot.
            controller: the controller.
            estimator: whether a state estimator stands before it.
            plant: what is simulated, and baselines are designed for.
            rules: v2 (simulation), hardware or hardware-perturbed.
            json: print one JSON object.
            save: also write the trajectory to this CSV file.
            disturbance: disturbances of the run; the boards' runs have none.
        """
        chosen, output = self.board("performance", rules), Output(json, save)
        return judge_performance(robot, controller, plant.make(), estimator, chosen, disturbance, output)

    def robustness(
        self,
        robot: RobotName,
        /,
        controller: ControllerName = DEFAULT,
        estimator: EstimatorFlags = AS_IT_COMES,
        plant: PlantFlags = NO_PLANT,
        rules: str = "v2",
        seed: int = 0,
        seeds: int = 1,
        criteria: tuple[str, ...] = CRITERIA,
        grid: tuple[str, ...] = (),
        json: bool = False,
    ) -> int:
        """Run the robustness benchmark, all its 722 simulations, and score it.

        Args:
            robot: the robot.
            controller: the controller.
            estimator: whether a state estimator stands before it.
            plant: what the grid is around, with disturbances in that pendulum's own units.
            rules: v2.
            seed: seed of the noise and the pushes.
            seeds: seeds in a row; with two or more the random criteria get 95 % intervals.
            criteria: some of model, velocity_noise, torque_noise, torque_response, delay and perturbations.
            grid: other values: NAME=LOW:HIGH:COUNT[:REPETITIONS] for a criterion or a parameter of the model, or
                perturbations=PROFILES.
            json: print one JSON object, with every single simulation.
        """
        criteria, grid = split_commas(criteria), split_commas(grid)
        changed, around = self.board("robustness", rules), plant.make()
        for text in grid:
            changed = change_grid(changed, text)

        def judge(found: Controller, on: Robot, progress: Progress) -> Robustness:
            return robustness_of.robustness(found, on, controller, changed, seed, seeds, criteria, progress, around)

        # The result names the command that repeats it; the leaderboard shows it beside shipped rows.
        options = {"controller": controller, "rules": rules, "seed": seed, "seeds": seeds}
        command = ["swingup", "robustness", robot, *(f"--{name}={value}" for name, value in options.items())]
        command += [*estimator.flags, *plant.flags]
        command += ["--criteria", *criteria] if criteria != CRITERIA else []
        command += ["--grid", *grid] if grid else []
        output = Output(json, head={"command": shlex.join(command)}, indent=1)
        return judge_and_tell(robot, controller, estimator, judge, robustness_lines, output, around)

    def uptime(
        self,
        robot: RobotName,
        /,
        controller: ControllerName = DEFAULT,
        estimator: EstimatorFlags = AS_IT_COMES,
        plant: PlantFlags = NO_PLANT,
        rules: str = "v3",
        domain: DomainOrNone = None,
        seed: int = 0,
        seeds: int | None = None,
        json: bool = False,
        save: str | None = None,
    ) -> int:
        """Run a minute of the global-policy benchmark, in which the pendulum is thrown ten or fifteen times.

        Args:
            robot: the robot.
            controller: the controller.
            estimator: whether a state estimator stands before it.
            plant: what is thrown by the rules v3, by a PID in that pendulum's own units.
            rules: v3 (simulation), icra-real (the real robot's, simulated; throws at limits as well), or
                cloudpendulum (four drawn cells of 30 s, with moves and kicks).
            domain: plants and loops for rules other than v3: identified, randomised, recorded (for icra-real by
                default), cells (for cloudpendulum), or a YAML file. Baselines are designed for its plant.
            seed: seed of the throws, and of plants and noise.
            seeds: seeds in a row, whose mean is the score; 1 for v3 by default, else as many as a board has runs.
            json: print one JSON object.
            save: also write the first seed's trajectory to this CSV file.
        """
        chosen, thrown = self.board("uptime", rules), plant.make()

        def judge(found: Controller, on: Robot, progress: Progress) -> Uptime:
            return uptime_of.uptime(found, on, controller, chosen, seed, seeds, progress, thrown, drawn)

        drawn = uptime_of.minute_domain(chosen, domain, thrown)
        designed_for = thrown if drawn is None else drawn.design_plant
        return judge_and_tell(robot, controller, estimator, judge, uptime_lines, Output(json, save), designed_for)

    def sim2real(
        self,
        robot: RobotName,
        /,
        controller: ControllerName = DEFAULT,
        estimator: EstimatorFlags = AS_IT_COMES,
        rules: str = SUCCESS,
        domain: DomainOrNone = None,
        plant: PlantFlags = NO_PLANT,
        seed: int = 0,
        seeds: int | None = None,
        json: bool = False,
        save: str | None = None,
    ) -> int:
        """Swing up on a plant and in a loop like the real robot's, with friction, delay and noise, many times.

        Success is to be up for the last 2 s of 10 without ever reaching 20 rad/s or 4π, where the robot stops.

        Args:
            robot: the robot.
            controller: the controller.
            estimator: whether a state estimator stands before it.
            rules: sim2real (success as above), or those of a real robot's board, which score what it records:
                iros-real (pushes on both joints) or v2-real (none).
            domain: plant and loop: identified, randomised or recorded (other plants for each seed), a session of
                the robot, as session-acrobot, or a YAML file. By default identified for sim2real, and recorded for
                the boards.
            plant: another plant than the domain's; the domain's loop is then in this plant's own units.
            seed: seed of noise and plants.
            seeds: seeds in a row; 100 for sim2real by default, and 10 for the boards.
            json: print one JSON object, with every run.
            save: also write the first seed's trajectory to this CSV file.
        """
        output, on = Output(json, save), plant.given()
        if rules != SUCCESS:
            chosen = self.board("trials", rules, (SUCCESS,))
            ranges = loop_around(on, chosen.domain if domain is None else domain)
            return judge_trials(chosen, ranges, robot, controller, estimator, seed, seeds, output)
        drawn = loop_around(on, "identified" if domain is None else domain)
        return judge_sim2real(drawn, robot, controller, estimator, seed, 100 if seeds is None else seeds, output)

    def board(self, measure: str, name: str, others: Sequence[str] = ()) -> Any:
        """Rules of one board; ``others`` are names that would do as well.

        Raises:
            SwingupError: no version of that name has such a board.
        """
        known = [*others, *(each for each, rules in self.rules.items() if getattr(rules, measure) is not None)]
        return getattr(self.rules[one_of(f"{measure} rules", name, known)], measure)
