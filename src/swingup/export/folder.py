"""Folders that need NumPy alone: our source, the policy, an entry for one robot's loop, and a README."""

import dataclasses
import json
import re
import shutil
import tempfile
from collections.abc import Mapping
from dataclasses import asdict
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path

from ..common import __version__
from ..common.errors import SwingupError, quoted
from ..common.files import behind_links, check_writable, write_atomically
from ..policy.feedback import FILE as LAW_FILE
from ..policy.feedback import FeedbackPolicy, RobotPolicy, write_feedback
from ..policy.file import write_network
from ..policy.guard import GuardSettings, default_guard
from ..policy.pendulum import write_pendulum_policy
from ..policy.policy import TaskPolicy
from ..policy.self_test import FILE as TEST_FILE
from ..policy.self_test import loop_test, task_test

NAME = "swingup"  # Name of an export unless another one is given
USERNAME = "swingup"  # On RealAIGym's leaderboard, unless another one is given


ROBOT_FORMS = {
    "realaigym": ("con_{name}.py", "readmes/{name}.md"),
    "cloudpendulum": ("controller_{name}.py", "README.md"),
}
"""A folder's entry and README by its form, which the entry's module and both templates are named after."""

FORMS = {"numpy": ("policy_{name}.py", "README.md"), **ROBOT_FORMS}  # The first is that of other tasks

CELL_VELOCITY = 50.0
"""Largest velocity of a joint in a CloudPendulum's cell (rad/s). Source: what teams report in 2026."""
CELL_TORQUE = 0.15
"""Largest torque there (N m). Source: the same."""

PACKAGE = "{name}_controller"
"""Name of the copied source, so that an installed swingup or another entry is never meant."""

COMMON_FILES = tuple(
    f"common/{name}.py" for name in ("__init__", "arrays", "checks", "errors", "files", "riccati", "settings")
)
"""What the folders ``plant`` and ``policy`` need besides themselves; a test runs them without the rest."""

NOT_ON_ROBOTS = ("chain.py", "measured.py", "model_file.py", "model_formats.py")
"""What reads and writes plants' files of other kinds."""

GUARDED_NOTE = (
    "It is behind a safety guard, whose settings are in the entry. `controller.fault` says why it stopped the\n"
    "controller, and `controller.reset()` lets it act again. Simulations beyond its limits need `guard = False`."
)
UNGUARDED_NOTE = "It has no safety guard: check every torque that goes to a motor."

JOINTS, ANY_RATE = ("shoulder", "elbow"), "any; 500 Hz on the leaderboards"

BY_AREAPO = "policy by AR-EAPO (average-reward entropy advantage policy optimisation)"

ABOUT = f'"""What a policy needs to run, copied from swingup {__version__} (Apache-2.0)."""\n'


def check_new(folder: str | Path) -> Path:
    """The folder behind links, since a move would replace a link; one that holds something is refused."""
    try:
        target = behind_links(folder)
        taken = target.exists() and (not target.is_dir() or any(target.iterdir()))
    except OSError as error:
        raise _unwritable(folder, error) from error
    if taken:
        raise SwingupError(f"{folder} is there already: name a folder that is new or empty")
    check_writable(target / NAME if target.exists() else folder)
    return target


def _unwritable(folder: str | Path, error: OSError) -> SwingupError:
    reason = error.strerror or error
    return SwingupError(f"cannot write {folder}: {reason}; choose a place that exists and can be written")


def export_folder(
    policy: TaskPolicy | RobotPolicy, folder: str | Path, form: str, name: str = NAME, username: str = USERNAME
) -> Path:
    """Write a folder, and say which file is the entry's.

    A new folder appears whole or not at all; an empty one gets its entry last. Others are refused. A pendulum's
    guard, which need not be the file's, is written into the entry.
    The copied source has the entry's name as well; the username is for RealAIGym's leaderboard.
    """
    pendulum = not isinstance(policy, TaskPolicy)
    if pendulum != (form in ROBOT_FORMS):
        kind, forms = "a pendulum", " or ".join(ROBOT_FORMS)
        if isinstance(policy, TaskPolicy):
            kind, forms = quoted(policy.task), "numpy"
        raise SwingupError(f"a folder of form {form} is not for {kind}: use {forms}")
    check_export_name(name)
    check_username(username)
    root, shared = resources.files("swingup"), {"NAME": name, "PACKAGE": PACKAGE.format(name=name)}
    shared |= {"ORIGIN": _origin(policy), "VERSION": __version__}
    entry, readme = (path.format(name=name) for path in FORMS[form])
    try:
        target = check_new(folder)
        # On the target's file system, where a move is a rename: a new folder appears whole or not at all.
        place = target if target.exists() else target.parent
        with tempfile.TemporaryDirectory(dir=place, prefix=f".{target.name}.") as temporary:
            made = Path(temporary) / target.name
            package = made / PACKAGE.format(name=name)
            interface = ["export/__init__.py", f"export/{form}.py"] if pendulum else []
            for file in (*_sources(root), *interface):
                _write(package / file, root.joinpath(*file.split("/")).read_bytes())
            # Not this package's own, which offers what the folder lacks.
            _write(package / "__init__.py", ABOUT.encode())
            if isinstance(policy, TaskPolicy):
                values, test = _task_values(policy), task_test(policy)
                write_network(package / "policy.safetensors", policy.network, policy.metadata)
            else:
                values = _pendulum_values(policy) | _guard_values(policy, username)
                test = loop_test(dataclasses.replace(policy, guard=None))
                if isinstance(policy, FeedbackPolicy):
                    write_feedback(package / LAW_FILE, policy)
                else:
                    write_pendulum_policy(package / "policy.safetensors", policy, policy.metadata)
            _write(package / TEST_FILE, test.to_json().encode())
            _write(made / entry, _filled(f"{form}.py.txt", shared | values))
            _write(made / readme, _filled(f"{form}.md", shared | values))
            # An empty folder stays, since a shell or a mount may use it; the entry comes last.
            parts = sorted(made.iterdir(), key=lambda each: each.name == entry)
            for each in [made] if place != target else parts:
                shutil.move(each, place)
    except OSError as error:
        raise _unwritable(folder, error) from error
    return target / entry


def check_export_name(name: str) -> str:
    """A name for an export, which must fit files, Python and C."""
    if not re.fullmatch(r"[a-z][a-z0-9_]{0,39}", name):
        raise SwingupError(f"name {quoted(name)}: use up to 40 small letters, digits and _, a letter first")
    return name


def check_username(username: str) -> None:
    """Refuse a name that does not fit a string of Python, and tables with commas."""
    if not username.isprintable() or any(sign in username for sign in '"\\,') or not 0 < len(username) <= 60:
        raise SwingupError(
            f"username {quoted(username)} does not fit an entry: use up to 60 letters, no quotes or commas"
        )


def cloudpendulum_guard(period: float | None) -> GuardSettings:
    """The guard of a policy whose file has none, for calls every ``period`` s; None for every 2 ms."""
    return dataclasses.replace(default_guard(period), velocity_limit=CELL_VELOCITY)


def cloudpendulum_notes(policy: RobotPolicy) -> list[str]:
    """What does not fit CloudPendulum's cells in a policy, as sentences."""
    return [
        f"it may command {limit:g} N m at the {joint}, and CloudPendulum's motors give {CELL_TORQUE:g}: use one "
        "that is made for its plant"
        for joint, limit in zip(JOINTS, policy.torque_limits, strict=True)
        if limit > CELL_TORQUE
    ]


def _sources(root: Traversable) -> list[str]:
    """Paths of what a controller needs of this package, besides its interface."""
    found, folders = list(COMMON_FILES), ["plant", "policy"]
    for folder in folders:
        for each in (root / folder).iterdir():
            path = f"{folder}/{each.name}"
            if each.name in NOT_ON_ROBOTS:
                continue
            if each.is_dir():
                # The loop goes on with it.
                folders.append(path)
            elif path.endswith(".py"):
                found.append(path)
    return found


def _write(path: Path, content: bytes) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(path, content)


def _filled(template: str, values: Mapping[str, str]) -> bytes:
    """A file of ``assets`` with its gaps, which stand there as ``@LIKE_THIS@``, filled."""
    text = (resources.files(__package__) / "assets" / template).read_text(encoding="utf-8")
    return re.sub(r"@([A-Z0-9_]+)@", lambda match: values[match[1]], text).encode()


def _guard_values(policy: RobotPolicy, username: str) -> dict[str, str]:
    """The guard's settings, for their owner to change, and whose entry it is."""
    guard = "False"
    if policy.guard is not None:
        # Python has JSON's numbers; of its words, null alone occurs here.
        guard = json.dumps(asdict(policy.guard), indent=4).replace("null", "None").replace("\n}", ",\n}")
    note = GUARDED_NOTE if policy.guard else UNGUARDED_NOTE
    return {"GUARD": guard, "GUARD_NOTE": note, "USERNAME": username}


def _origin(policy: TaskPolicy | RobotPolicy) -> str:
    command = policy.metadata.get("command")
    return f"- The policy file was made by `{command}`." if isinstance(command, str) else ""


def _task_values(policy: TaskPolicy) -> dict[str, str]:
    """What a folder says of a task's policy, for the gaps of a template."""
    return {
        # Between quotes of Python and in Markdown: what might end either is left out.
        "TASK": re.sub(r"[^\w./: -]", "_", policy.task)[:60],
        "OBSERVATION": f"shape {policy.observation_space.shape}, {policy.observation_space.dtype}",
        "ACTION": f"shape {policy.action_space.shape}, {policy.action_space.dtype}",
        "RATE": f"one call every {policy.period:g} s" if policy.period else "one call at every step of the task",
    }


def _pendulum_values(policy: RobotPolicy) -> dict[str, str]:
    """What a folder's README and entry say of a pendulum's controller, for the gaps of a template."""
    robot, seen = policy.robot, _seen(policy)
    rate = f"one call every {policy.period:g} s" if policy.period else ANY_RATE
    values = {"ESTIMATOR": seen, "TORQUE": _torque(policy), "RATE": rate, "ROBOT": robot.name}
    if isinstance(policy, FeedbackPolicy):
        top, kind = "a linear-quadratic regulator holds it upright", f"The optimal-control baseline {policy.name}"
        law = f"{top[0].upper()}{top[1:]}." if policy.swing_up is None else f"It follows a swing-up, then {top}."
        return values | {"DESCRIPTION": kind, "KIND": kind, "LAW": law, "METHOD": policy.name}
    layers = " and ".join(str(len(layer.bias)) for layer in policy.network.trunk)
    kind, switched = f"A {BY_AREAPO}", "nothing is switched, tracked or planned"
    made, method = "Average-reward maximum-entropy RL (AR-EAPO): one network", "AR-EAPO"
    if policy.regulator:
        kind = f"A network distilled from teachers, one of which is a {BY_AREAPO}"
        switched = "near upright a linear-quadratic regulator takes over"
        made, method = "One network distilled from teachers (one by AR-EAPO) with a regulator", "distilled"
    made += " behind a state estimator" if policy.estimator else ""
    joint = JOINTS[robot.joint]
    law = f"One network with hidden layers of {layers} units gives the torque of the {joint}; {switched}."
    return values | {"DESCRIPTION": made, "KIND": kind, "LAW": law, "METHOD": method}


def _seen(policy: RobotPolicy) -> str:
    base = " and the pendulum's base parameters" if policy.identifier else ""
    filtered = f"an estimate of the state by a Kalman filter, which also finds the loop's delay{base}"
    return f"It is shown {filtered if policy.estimator else 'the measured state'}."


def _torque(policy: RobotPolicy) -> str:
    maximum = f"at most {policy.torque_limit:g} N m"
    joint, passive = JOINTS[policy.robot.joint], JOINTS[1 - policy.robot.joint]
    if policy.identifier is None:
        return f"{maximum}, on the {joint} alone"
    return (
        f"{maximum} on the {joint}, and compensation of friction: there, and within "
        f"{policy.identifier.passive_limit:g} N m on the {passive}"
    )
