"""The conventions and units of a log's columns: the table of what people have, each with its test and remedy.

A convention is a linear map from the columns to angles and torques. Its test is the regression: the motion is much
likelier under the right map. Conventions come in pairs, so pairs are tried as well. The remedy is the text of
``--columns`` that gives the columns their right meaning.
"""

import functools
import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..common.columns import DEGREE, NEEDS_CONSTANT, TURN, UNITS, MappedColumn, completed, unit_of, unit_size
from ..common.errors import SwingupError
from ..common.expressions import Expression
from .log_checks import slopes_of
from .prediction import Integration
from .recording import Recording
from .regression import AS_IS, MINIMUM_SPANS, ColumnMap, Solution, cut_spans, regress, servo_gains
from .scoring import prediction_skill
from .segments import Segments

LIKELIER_COST = math.log(2.0)
"""Difference of costs from which another map is named: real logs have at most log 1.4."""
GOOD_SHARE, BETTER_SHARE = 0.3, 0.7
"""Another map must also leave less than these shares unexplained, of the motion and of what the log as it is
leaves: with much noise another map may be likelier and no better."""
STILL_BETTER_SHARE = 0.9
"""``BETTER_SHARE`` where hardly anything moves as the log is: there angles in turns are likely from the start."""
PAIR_LIKELIER_COST = math.log(1.5)  # difference of costs from which a pair is named rather than one convention
SUSPICIOUS_SHARE = 0.08  # unexplained share from which pairs are tried
FOREIGN_SHARE, UNPREDICTED_SHARE = 0.3, 0.5
"""A log is refused above this unexplained share, if the better of start and regression also predicts the angles
after 0.25 s with an error above this share of their motion."""
FREE_FALL = (0.1, 0.15)
"""A log without torques is not a free fall above this unexplained share, if masses end at their bounds or
predictions have a larger error than this; recordings of free falls have 0.07 and 0.09."""
MISMATCH_RATIO = 1.5
"""Ratio of the angles' slopes to recorded velocities, or its inverse, that noise does not explain."""
TORQUE_SIZES = tuple(np.geomspace(1e-4, 10.0, 101).tolist())  # sizes (N m) that the torques' unit may have
SIMILAR_UNIT = 1.5  # ratio to the likeliest size up to which a unit is named
MAXIMUM_SPEED = 400.0  # speed (rad/s) that no map may give
MINIMUM_COUNTS = 50.0  # range from which angles in whole numbers are counts
COUNTS = (
    *(2**k for k in range(8, 21)),
    *(500, 800, 1000, 1440, 2000, 3600, 4000, 5000, 7200, 8000, 10000, 14400, 20000, 36000, 40000),
)
"""Counts per turn of encoders on the market."""

_SAME, _SWAP, _TURN1, _TURN2 = np.eye(2), np.eye(2)[::-1], np.diag([-1.0, 1.0]), np.diag([1.0, -1.0])
_RELATIVE = np.array([[1.0, 0.0], [-1.0, 1.0]])


class Convention(NamedTuple):
    """One other way to write the columns, and the map that undoes it."""

    group: str  # at most one convention of a group holds
    text: str
    angles: Float[np.ndarray, "2 2"] = _SAME
    torques: Float[np.ndarray, "2 2"] = _SAME
    shift: tuple[float, float] = (0.0, 0.0)


QUARTER = math.pi / 2
CONVENTIONS = (
    Convention("order", "joints 1 and 2 look swapped", _SWAP, _SWAP),
    Convention("sign", "the angle of joint 1 looks reversed", _TURN1),
    Convention("sign", "the angle of joint 2 looks reversed", _TURN2),
    Convention("sign", "joint 1, with its torque, looks reversed", _TURN1, _TURN1),
    Convention("sign", "joint 2, with its torque, looks reversed", _TURN2, _TURN2),
    Convention("elbow", "the angle of joint 2 looks absolute, not relative to link 1", _RELATIVE),
    Convention("zero", "the angle of joint 1 looks measured from upright, not from hanging", shift=(math.pi, 0.0)),
    Convention("zero", "the angle of joint 1 looks measured from the horizontal", shift=(QUARTER, 0.0)),
    Convention("zero", "the angle of joint 1 looks measured from the horizontal", shift=(-QUARTER, 0.0)),
    Convention(
        "zero", "the angle of joint 2 looks zero with the elbow folded, not stretched", shift=(0.0, math.pi)
    ),
    Convention("zero", "the angle of joint 2 looks zero at a right angle", shift=(0.0, QUARTER)),
    Convention("zero", "the angle of joint 2 looks zero at a right angle", shift=(0.0, -QUARTER)),
    Convention("torque", "the torques of joints 1 and 2 look swapped", torques=_SWAP),
    Convention("torque", "the torque of joint 1 looks reversed", torques=_TURN1),
    Convention("torque", "the torque of joint 2 looks reversed", torques=_TURN2),
    Convention("torque", "both torques look reversed", torques=-_SAME),
    Convention("torque", "the torques look swapped, and that of joint 1 reversed", torques=_TURN1 @ _SWAP),
    Convention("torque", "the torques look swapped, and that of joint 2 reversed", torques=_TURN2 @ _SWAP),
    Convention("torque", "the torques look swapped and reversed", torques=-_SWAP),
    Convention("unit", "the angles look like degrees", DEGREE * _SAME),
    Convention("unit", "the angle of joint 1 looks like degrees", np.diag([DEGREE, 1.0])),
    Convention("unit", "the angle of joint 2 looks like degrees", np.diag([1.0, DEGREE])),
    Convention("unit", "the angles look like turns", TURN * _SAME),
    *(
        Convention("unit of torque", f"the {torques} like", torques=np.diag(np.where(joints, size, 1.0)))
        for torques, joints, sizes in (
            ("torques look", (True, True), (1e-3, 1e-2)),
            ("torque of joint 1 looks", (True, False), (1e-3, 1e-2, 0.1)),
            ("torque of joint 2 looks", (False, True), (1e-3, 1e-2, 0.1)),
        )
        for size in sizes
    ),
)
"""Applied in the order of the table, units first; ``_name_unit`` finds the units that are like these."""
GROUPS = tuple(dict.fromkeys(["unit", *(each.group for each in CONVENTIONS)]))


@dataclass(frozen=True)
class Finding:
    """What is wrong with a log's columns."""

    text: str
    remedy: tuple[str, ...] = ()  # words of ``--columns``
    given: tuple[str, ...] = ()  # those with which the log was read

    def __str__(self) -> str:
        words = completed(self.remedy, self.given) if self.remedy else ""
        return f"{self.text}; {f'if so, read it with --columns {words}' if words else 'correct the columns'}"


def check_columns(
    recording: Recording, setting: Integration, start: Float[np.ndarray, "15"], force: bool = False
) -> tuple[str, ...]:
    """Refuse a log whose columns follow other conventions or units; with ``force``, return what is refused."""
    found = find_columns(recording, setting, start)
    if found is None:
        return ()
    found = replace(found, given=recording.columns)
    if force:
        return (f"{recording.name}: {found}; taken as it is",)
    raise SwingupError(f"{recording.name}: {found}, or take it as it is with --force")


def find_columns(recording: Recording, setting: Integration, start: Float[np.ndarray, "15"]) -> Finding | None:
    """What is wrong with a log's columns, if anything is.

    The likeliest convention is named if it also explains clearly more of the motion than the columns as they are.
    Otherwise only their units, their velocities and a pendulum far from the start may be wrong.
    """
    if recording.goals is not None:
        return _servo_law(recording.goals, setting, start)
    driven = any(recording.driven)
    conventions = [
        each for each in (*CONVENTIONS, *_own_units(recording, setting)) if driven or "torque" not in each.group
    ]
    spans, singles, better = cut_spans(recording), conventions, BETTER_SHARE
    if len(spans) < MINIMUM_SPANS:  # at rest, or in turns, whose speeds are small numbers
        spans, better = cut_spans(recording, 1.0 / TURN), STILL_BETTER_SHARE
        singles = [each for each in conventions if np.array_equal(each.angles, TURN * _SAME)]
    wrong_units = _check_speed(recording) or _check_velocities(recording)
    if len(spans) < MINIMUM_SPANS:
        return wrong_units
    maps = _Maps(setting, spans, start, recording.driven)
    plain = maps.solve(())
    best, found = _likeliest(maps, plain, singles, conventions)
    if found.cost < plain.cost - LIKELIER_COST and found.unexplained < min(GOOD_SHARE, better * plain.unexplained):
        named = [_name_unit(maps, best, each) for each in best]
        # With much noise a unit may be likelier although the torques are right.
        named = [
            each for each in named if each.group != "unit of torque" or not np.array_equal(each.torques, _SAME)
        ]
        if named:
            shares = f"as it is, {_share(plain)} of the motion stays unexplained, otherwise {_share(found)}"
            texts = " and ".join(dict.fromkeys(each.text for each in named))
            return Finding(f"{texts}: {shares}", remedy(recording, column_map(named)))
    return wrong_units or _check_foreign(recording, setting, start, plain)


def _servo_law(goals: Recording, setting: Integration, start: np.ndarray) -> Finding | None:
    """The servos' law as a torque, with gains that fit the starting plant."""
    spans = cut_spans(goals)
    if len(spans) < MINIMUM_SPANS:
        return None
    words, shown = [], []
    velocities = next((pair for pair in goals.pairs if pair[0].startswith("vel")), None)
    for joint, (kp, kd) in enumerate(zip(*servo_gains(setting, spans, start), strict=True)):
        name = f"tau_con{joint + 1}"
        law = goals.sources[name].expression.times(float(f"{kp:.2g}"))
        if velocities is not None:
            velocity = goals.sources[velocities[joint]]
            damping = float(f"{-kd * unit_size(velocities[joint], velocity.unit):.2g}")
            law = law.plus(velocity.expression.times(damping)) if damping else law
        words.append(MappedColumn(law).word(name))
        shown.append(f"{kp:.2g} and {kd:.2g}")
    return Finding(
        "it has goals of servos and no torques, which are kp (goal - angle) - kd velocity: on the starting plant "
        f"kp and kd of joint 1 are about {shown[0]}, of joint 2 {shown[1]}. Give the servos' own: a factor on both "
        "scales all masses, and kd is like damping. A clipped torque is clip(8*(goal-angle),-2,2)",
        tuple(words),
    )


def _likeliest(
    maps: "_Maps", plain: Solution, singles: Sequence[Convention], conventions: Sequence[Convention]
) -> tuple[Sequence[Convention], Solution]:
    """The likeliest convention, or the likeliest pair where no single one explains the motion."""
    best: Sequence[Convention]
    best, found = min((((each,), maps.solve((each,))) for each in singles), key=lambda each: each[1].cost)
    # There are hundreds of pairs: trying them all takes most of the time of this check.
    if min(plain.unexplained, found.unexplained) > SUSPICIOUS_SHARE:
        pairs = [pair for pair in itertools.product(singles, conventions) if pair[0].group != pair[1].group]
        # A command's age hardly matters to what is decided here.
        pair, solution = min(((pair, maps.solve(pair, ages=1)) for pair in pairs), key=lambda each: each[1].cost)
        if solution.cost < found.cost - PAIR_LIKELIER_COST:
            return pair, solution
    return best, found


def column_map(conventions: Sequence[Convention]) -> ColumnMap:
    """The map of several conventions: units come first, then the order of the table."""
    found = AS_IS
    for each in sorted(conventions, key=lambda each: GROUPS.index(each.group)):
        found = found.then(ColumnMap(each.angles, np.array(each.shift), each.torques))
    return found


class _Maps:
    """The regression of one log under many maps of its columns, each solved once."""

    def __init__(self, setting: Integration, spans: Segments, start: np.ndarray, driven: Sequence[bool]) -> None:
        self.arguments = setting, spans, start, any(driven)
        self.moving = np.array(driven, float)
        self.fastest = np.quantile(np.abs(spans.states[..., 2:]), 0.99, axis=(0, 1))
        self.solved: dict[bytes, tuple[int, Solution]] = {}  # And for how many ages

    def solve(self, conventions: Sequence[Convention], ages: int = 4) -> Solution:
        """The regression's solution; maps that are the same, or another's mirror image, are solved once."""
        columns = column_map(conventions)
        if np.any(np.abs(columns.angles) @ self.fastest > MAXIMUM_SPEED):
            return Solution({}, 1.0, 1e6, bounded=True)
        # Shifts as points of the circle, where those that differ by a turn are equal.
        numbers = [columns.angles.ravel(), np.exp(1j * columns.shift), (columns.torques * self.moving).ravel()]
        sign = 1.0 if columns.angles[0].sum() > 0 else -1.0
        mirrored = [sign * numbers[0], numbers[1] if sign > 0 else numbers[1].conj(), sign * numbers[2]]
        # Adding 0 makes 0 of -0, whose bytes differ.
        key = (np.round(np.concatenate(mirrored), 6) + 0.0).tobytes()
        # Pairs are solved for one age alone: such a solution does not serve where all ages count.
        if self.solved.get(key, (0,))[0] < ages:
            self.solved[key] = ages, regress(*self.arguments, columns, ages)
        return self.solved[key][1]


def _name_unit(maps: _Maps, best: Sequence[Convention], guess: Convention) -> Convention:
    """A convention; of a unit of torque, the size that fits the starting plant's masses best, and its name."""
    if guess.group != "unit of torque":
        return guess
    joints = np.diag(guess.torques) < 1.0
    others = [each for each in best if each is not guess]

    def sized(size: float) -> Convention:
        return guess._replace(torques=np.diag(np.where(joints, size, 1.0)))

    def cost(size: float) -> float:
        # The masses stay, since they would make up for a unit.
        return regress(*maps.arguments, column_map([*others, sized(size)]), 1, maximum_factor=1.001).cost

    size = min(TORQUE_SIZES, key=cost)
    plain = {name: each for name, each in UNITS["tau"].items() if name.lower() not in NEEDS_CONSTANT}
    distances = {name: abs(math.log(each / size)) for name, each in plain.items()}
    named = sorted((name for name in plain if distances[name] < math.log(SIMILAR_UNIT)), key=distances.__getitem__)
    found = sized(plain[named[0]] if named else float(f"{size:.2g}"))
    return found._replace(text=f"{guess.text} {' or '.join(named) or f'a unit of {size:.2g} N m (percent, mA?)'}")


def _share(solution: Solution) -> str:
    return f"{min(solution.unexplained, 1.0):.0%}"


def _own_units(recording: Recording, setting: Integration) -> Iterable[Convention]:
    """Units that only this log may have: counts of an encoder, angles of a motor."""
    angles = recording.q
    if np.ptp(angles) > MINIMUM_COUNTS and np.all(angles == np.round(angles)):
        correlations, ratios = _velocity_relations(recording, _SAME, _SAME)
        # Velocities in rad/s show the counts of a turn, and so does the angle at which counts wrap.
        shown = [
            TURN * ratio for match, ratio in zip(correlations, ratios, strict=True) if match > 0.9 and ratio > 30.0
        ]
        for count in COUNTS if recording.turn is None else (round(recording.turn),):
            if all(abs(count / each - 1) < 0.01 for each in shown):
                yield Convention("unit", f"the angles look like counts, {count} a turn", TURN / count * _SAME)
    if (gear := setting.geometry.gr) > 1.0:
        yield Convention("unit", f"the angles look like the motors', {gear:g} times the joints'", _SAME / gear)


def remedy(recording: Recording, columns: ColumnMap) -> tuple[str, ...]:
    """Words of --columns that give the columns this map."""
    words: list[str] = []
    for names in recording.pairs:
        # Velocities may follow another convention than the angles: their relation to the slopes decides.
        if names[0].startswith("vel"):
            words += _velocity_words(recording, names, columns.angles)[0]
            continue
        angles = names[0].startswith("pos")
        matrix, shift = (columns.angles, columns.shift) if angles else (columns.torques, np.zeros(2))
        for name, row, constant in zip(names, matrix, shift, strict=True):
            column = _combined(recording.sources, names, row, float(constant))
            if column != recording.sources[name]:
                words.append(column.word(name))
    return tuple(words)


def _combined(
    sources: Mapping[str, MappedColumn], names: Sequence[str], row: np.ndarray, constant: float = 0.0
) -> MappedColumn:
    """A row of a map as a column: signs of the columns, one unit, and the constant in it."""
    scale, quantity = float(np.abs(row).max()), names[0][:3]
    own = next(sources[name].unit for name, each in zip(names, row, strict=True) if each)
    size = unit_size(names[0], own) * scale
    parts = [
        sources[name].expression.times(float(np.sign(each))) for name, each in zip(names, row, strict=True) if each
    ]
    # What is added comes first: an expression that begins with a minus reads badly.
    parts.sort(key=lambda part: bool(part.terms) and part.terms[0][0] < 0)
    unit = own if scale == 1.0 else unit_of(quantity, size, within=0.1 if quantity == "vel" else 1e-9)
    standard = next(iter(UNITS[quantity]))
    # The title may have another unit, which an empty one would leave.
    unit = "" if unit == standard and not own else unit
    return MappedColumn(functools.reduce(Expression.plus, parts, Expression((), constant / size)), unit)


def _check_speed(recording: Recording) -> Finding | None:
    """Angles whose slopes no pendulum has."""
    fastest = np.quantile(np.abs(np.diff(recording.q, axis=0) / np.diff(recording.time)[:, None]), 0.99, axis=0)
    if fastest.max() <= MAXIMUM_SPEED:
        return None
    joint = int(np.argmax(fastest))
    return Finding(
        f"joint {joint + 1} moves at {fastest[joint]:.0f} rad/s: give the unit of the angles, as in --columns "
        f"{recording.sources[recording.pairs[0][joint]].word(f'pos_meas{joint + 1}')}:deg, :mrad or :counts/4096"
    )


def _check_velocities(recording: Recording) -> Finding | None:
    """Velocities that are another joint's, reversed, or in another unit than the angles."""
    names = next((pair for pair in recording.pairs if pair[0].startswith("vel")), None)
    words, text = ((), "") if names is None else _velocity_words(recording, names, _SAME)
    return Finding(text, words) if words else None


def _velocity_words(recording: Recording, names: Sequence[str], angles: np.ndarray) -> tuple[tuple[str, ...], str]:
    """Words for velocities that do not follow the angles under their map, and what is wrong with them.

    Velocities may be right as they are, follow the angles' convention, or be swapped: of these three the one counts
    whose velocities correlate best with the angles' slopes. The ratio of both then gives sign and unit.
    """
    maps = (_SAME, np.round(angles / np.abs(angles).max()), _SWAP)
    relations = [_velocity_relations(recording, angles, each) for each in maps]
    # The joint that correlates worse decides. Of equal maps the first counts, and joints of one unit are likelier.
    scores = [
        np.abs(correlations).min() - 0.02 * place - 0.1 * np.ptp(np.log(np.abs(ratios) + 1e-9))
        for place, (correlations, ratios) in enumerate(relations)
    ]
    best = int(np.argmax(scores))
    words: list[str] = []
    text = "the velocities of joints 1 and 2 are swapped" if maps[best] is _SWAP else ""
    for joint, (correlation, ratio) in enumerate(zip(*relations[best], strict=True)):
        # Noise and filters change the ratio by less than any unit does.
        factor = np.sign(ratio) if 1 / MISMATCH_RATIO < abs(ratio) < MISMATCH_RATIO else ratio
        column = _combined(recording.sources, names, maps[best][joint] * factor)
        # Without a clear relation velocities are noise: the fit does not use them.
        if abs(correlation) > 0.8 and column != recording.sources[names[joint]]:
            words.append(column.word(names[joint]))
            difference = "has the opposite sign of" if ratio < 0 else f"is {1 / ratio:.3g} times"
            text = text or f"velocity {joint + 1} {difference} its angle's slope"
    return tuple(words), text


def _velocity_relations(
    recording: Recording, angles: Float[np.ndarray, "2 2"], velocities: Float[np.ndarray, "2 2"]
) -> tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2"]]:
    """Correlations of angles' slopes with recorded velocities, each under a map, and their ratios.

    Both have noise, so that a ratio is that of their spreads, signed.
    """
    slopes = slopes_of(recording.time[recording.fresh], recording.q[recording.fresh]) @ angles.T
    recorded = recording.dq[recording.fresh] @ velocities.T
    inner = np.sum(slopes * recorded, axis=0)
    sizes, others = np.linalg.norm(slopes, axis=0), np.maximum(np.linalg.norm(recorded, axis=0), 1e-12)
    return inner / np.maximum(sizes * others, 1e-12), np.where(inner < 0, -1.0, 1.0) * sizes / others


def _check_foreign(
    recording: Recording, setting: Integration, start: np.ndarray, plain: Solution
) -> Finding | None:
    """A motion that neither the starting plant nor the regression's explains."""
    driven = any(recording.driven)
    unexplained, unpredicted = (FOREIGN_SHARE, UNPREDICTED_SHARE) if driven else FREE_FALL
    if plain.unexplained < unexplained:
        return None
    # What a plant predicts well has the right columns, whatever the regression leaves unexplained.
    predicted = prediction_skill(recording, setting, start, plain.values) < unpredicted
    if not driven and (plain.bounded or not predicted):
        return Finding(
            f"torques that are not in the log act: without any, {_share(plain)} of the motion stays unexplained"
        )
    if predicted:
        return None
    return Finding(
        f"the pendulum is not near the starting plant: {_share(plain)} of the motion stays unexplained; "
        "check units and columns, or give another --start"
    )
