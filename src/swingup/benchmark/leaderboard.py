"""The boards: rows of our controllers, computed here, beside the published ones."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from ..common.errors import SwingupError
from ..controllers.baselines.baselines import BASELINES
from ..controllers.registry import designs_for, get_controller, has_estimator
from ..loop.domain import load_domain
from ..plant.plant import LEADERBOARD, Plant, PlantLike, load_plant
from ..plant.robots import Robot, get_robot
from ..policy.shipped import ADAPTIVE, AR_EAPO, GLOBAL
from .board_rows import OURS, Row, published_rows, shipped_robustness
from .board_rules import BoardRules, get_board_rules
from .columns import BOARDS, PERFORMANCE
from .evaluate import evaluate
from .robustness import robustness
from .rules import DEFAULT_RULES
from .runner import Progress
from .seeds import check_seeds
from .trials import trials
from .uptime import uptime

ENTRANTS = (AR_EAPO, "tvlqr", "ilqr-riccati", "ilqr-mpc")
"""The paper's controllers, by our names."""
FURTHER = (ADAPTIVE, "tvlqr-score")
"""Further controllers of ours that enter every board beside the paper's."""
FOR_THROWS = (GLOBAL,)
"""Those that enter only the boards with throws."""
ALONE = " --no-estimator"
"""Ends the name of a shipped policy that enters a second time, without its estimator."""

SHIPPED_ROBUSTNESS = ("ilqr-mpc",)
"""Controllers whose robustness takes many minutes: the package ships the output of the command."""


_Maker = Callable[[Any, Robot, str], Row]

RowProgress = Callable[[str, int, int], None]
"""Called with the row that is being computed, the number of its finished simulations, and of all."""


@dataclass(frozen=True)
class Board:
    """One table of controllers, best first."""

    robot: str
    measure: str
    """``performance``, ``robustness`` (criteria in %, overall from 0 to 1) or ``uptime``; with ``robot_`` before it
    for trials on the simulated robot."""
    rules: str
    seed: int | None
    """Of the noise, pushes or throws; None where nothing is random."""
    rows: tuple[Row, ...]
    plant: Plant = LEADERBOARD
    note: str | None = None
    """What the rules say of the board."""

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the criteria, the score last."""
        return BOARDS[self.measure]

    def as_dicts(self) -> list[dict[str, Any]]:
        """One flat object a row, ready for JSON."""
        head = {"robot": self.robot, "measure": self.measure, "rules": self.rules, "seed": self.seed}
        head |= self.plant.summary(self.robot)
        names = ("controller", "source", "remark")
        return [head | {name: getattr(row, name) for name in names} | dict(row.values) for row in self.rows]


def leaderboard(
    robot: Robot | str,
    controllers: Mapping[str, Any] | None = None,
    rules: BoardRules | str = DEFAULT_RULES,
    seed: int = 0,
    recompute: bool = False,
    entrants: Sequence[str] | None = None,
    progress: RowProgress | None = None,
    plant: PlantLike = LEADERBOARD,
) -> list[Board]:
    """Every board of a version of the rules, with our rows computed now.

    Args:
        robot: which joint is driven.
        controllers: controllers by name, in JAX or plain Python, that enter beside ours.
        rules: ``v2`` (performance and robustness), ``hardware`` or ``hardware-perturbed`` (performance), ``v3``
            (uptime), ``iros-real``, ``v2-real``, ``icra-real`` or ``cloudpendulum`` (runs on simulated robots), or
            others as data.
        seed: of noise, pushes and throws.
        recompute: also compute the rows that the package ships because they take minutes.
        entrants: names of the built-in controllers that enter; None for those of the rules.
        progress: called before each row and while it is computed.
        plant: what the controllers are judged on, and the baselines designed for: a plant, its name
            or its file. Boards of another plant than the leaderboards' have no published or shipped rows.

    Raises:
        SwingupError: there is no such robot or plant, there are no such rules, or the seed is out of range. The row
            of a controller that fails says so.
    """
    robot, rules, seed = get_robot(robot), get_board_rules(rules), check_seeds(seed, 1)[0]
    names, found = default_entrants(rules) if entrants is None else entrants, load_plant(plant)
    designed_for = _designed_for(rules, found)
    entered = entrants_for(robot, controllers or {}, names, alone=True, plant=designed_for)
    makers = _makers(rules, seed, recompute or found != LEADERBOARD, progress, found)
    return [
        replace(_board(robot, measure, rules.name, seed, entered, make_row, found), note=_note_of(rules))
        for measure, make_row in makers.items()
    ]


def default_entrants(rules: BoardRules) -> tuple[str, ...]:
    """Names of the built-in controllers on the boards of a version of the rules."""
    if rules.uptime is not None and rules.uptime.cell is not None:
        return tuple(name for name in ENTRANTS if name in BASELINES)  # the shipped policies were made for C.1
    return (*ENTRANTS, *FURTHER, *(FOR_THROWS if rules.uptime else ()))


def _note_of(rules: BoardRules) -> str | None:
    return rules.uptime.note if rules.uptime else None


def _domain_of(rules: BoardRules) -> str | None:
    """The domain of rules of a robot, which draw plants and loops."""
    return rules.trials.domain if rules.trials else rules.uptime.domain if rules.uptime else None


def _designed_for(rules: BoardRules, plant: Plant) -> Plant:
    """What baselines are designed for: the plant that is judged on, or that a robot's domain starts from."""
    domain = _domain_of(rules)
    if domain is None:
        return plant
    if plant != LEADERBOARD:
        raise SwingupError(f"the rules {rules.name} draw plants from a domain: leave the plant {plant} out")
    return load_domain(domain).design_plant


def entrants_for(
    robot: Robot,
    others: Mapping[str, Any],
    names: Sequence[str] = ENTRANTS,
    alone: bool = False,
    plant: PlantLike = LEADERBOARD,
) -> dict[str, Any]:
    """Built-in controllers and others, by name.

    Args:
        robot: which joint is driven.
        others: controllers of the user.
        names: the built-in controllers.
        alone: whether a policy that ships with an estimator enters a second time without it.
        plant: what baselines are designed for.

    Raises:
        SwingupError: another controller has a name of ours.
    """
    _check_names(others, names)  # before controllers are made, which takes seconds
    ours = {name: get_controller(name, robot, plant=designs_for(name, plant)) for name in names}
    twice = [name for name in names if alone and has_estimator(ours[name])]
    ours |= {f"{name}{ALONE}": get_controller(name, robot, False, designs_for(name, plant)) for name in twice}
    # Again, for the names without an estimator: they are known only now.
    _check_names(others, ours)
    return ours | dict(others)


def _check_names(others: Iterable[str], ours: Iterable[str]) -> None:
    taken = sorted(set(others) & set(ours))
    if taken:
        raise SwingupError(f"controller {taken[0]!r} is on the board already: give yours another name")


def _makers(
    rules: BoardRules, seed: int, recompute: bool, progress: RowProgress | None, plant: Plant
) -> dict[str, _Maker]:
    """One function for each board of a version of the rules: it fills a row."""

    def told(name: str, measure: str) -> Progress:
        def tell(done: int, total: int) -> None:
            if progress is not None:
                progress(f"{name}, {measure}", done, total)

        # Told at once: compilation comes before the first finished simulation.
        tell(0, 1)
        return tell

    def performance(controller: Any, robot: Robot, name: str) -> Row:
        assert rules.performance is not None
        told(name, "performance")
        criteria = evaluate(controller, robot, name, rules.performance, plant=plant).criteria
        remark = None if criteria.success else "no swing-up"
        return Row(name, OURS, {column: getattr(criteria, column) for column in PERFORMANCE}, remark)

    def resilience(controller: Any, robot: Robot, name: str) -> Row:
        assert rules.robustness is not None
        if name in SHIPPED_ROBUSTNESS and not recompute:
            return shipped_robustness(robot, name)
        shown = told(name, "robustness")
        result = robustness(controller, robot, name, rules.robustness, seed, progress=shown, plant=plant)
        faults = result.faults
        remark = f"{len(faults)} simulations without an answer; the first: {faults[0].fault}" if faults else None
        return Row(name, OURS, {**result.percent, "overall": result.overall}, remark)

    def thrown(controller: Any, robot: Robot, name: str) -> Row:
        assert rules.uptime is not None
        seeds, shown = rules.uptime.trials, told(name, "uptime")
        result = uptime(controller, robot, name, rules.uptime, seed, seeds, progress=shown, plant=plant)
        values = {"uptime": result.uptime} | ({} if result.domain is None else {"best": result.best})
        return Row(name, OURS, values, next((fault for fault in result.faults if fault), None))

    def tried(controller: Any, robot: Robot, name: str) -> Row:
        assert rules.trials is not None
        result = trials(controller, robot, name, rules.trials, seed=seed, progress=told(name, "trials"))
        shares = {
            "successes": 100.0 * result.successes / len(result.runs),
            "best": result.best,
            "mean": result.score,
        }
        return Row(name, OURS, shares, next((run.fault for run in result.runs if run.fault), None))

    minute = "robot_uptime" if rules.uptime is not None and rules.uptime.domain is not None else "uptime"
    known: tuple[tuple[str, Any, _Maker], ...] = (
        ("performance", rules.performance, performance),
        ("robustness", rules.robustness, resilience),
        (minute, rules.uptime, thrown),
        ("robot_performance", rules.trials, tried),
    )
    return {measure: make for measure, given, make in known if given is not None}


def _board(
    robot: Robot,
    measure: str,
    rules: str,
    seed: int,
    entrants: Mapping[str, Any],
    make_row: _Maker,
    plant: Plant,
) -> Board:
    rows, score = published_rows(robot, measure, rules) if plant == LEADERBOARD else [], BOARDS[measure][-1]
    drawn = None if measure == "performance" else seed
    for name, controller in entrants.items():
        try:
            rows.append(make_row(controller, robot, name))
        except SwingupError as error:
            # One controller's failure must not cost the others their rows.
            rows.append(Row(name, OURS, {**dict.fromkeys(BOARDS[measure]), score: 0.0}, str(error)))
    ranked = tuple(sorted(rows, key=lambda row: -(row.values[score] or 0.0)))
    return Board(robot.name, measure, rules, drawn, ranked, plant)
