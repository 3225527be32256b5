"""Folders that need NumPy alone: our source, the policy, and an entry; the one for RealAIGym is here."""

import json
import shutil
import tempfile
from collections.abc import Mapping
from dataclasses import asdict
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path

from ..common.errors import SwingupError
from ..common.files import write_atomically
from ..common.text import quoted
from ..common.version import __version__
from ..policy.guard.settings import GuardSettings
from ..policy.pendulum import PendulumPolicy
from .template import NAME, asset, check_export_name, fill

PACKAGE = "{name}_controller"
"""Name of the copied source, so that an installed swingup or another entry is never meant."""

COMMON = tuple(
    f"common/{name}.py"
    for name in ("__init__", "arrays", "checks", "errors", "files", "riccati", "settings", "text")
)
"""What the folders ``plant`` and ``policy`` need besides themselves; a test runs them without the rest."""

GUARDED = (
    "It is behind a safety guard, whose settings are in the entry. `controller.fault` says why it stopped the\n"
    "controller, and `controller.reset()` lets it act again. Simulations beyond its limits need `guard = False`."
)
UNGUARDED = "It has no safety guard: check every torque that goes to a motor."

BY_AREAPO = "policy by AR-EAPO (average-reward entropy advantage policy optimisation)"

ABOUT = f'"""What a policy needs to run, copied from swingup {__version__} (Apache-2.0)."""\n'


def export_realaigym(
    policy: PendulumPolicy,
    source: Path,
    folder: str | Path,
    username: str,
    name: str = NAME,
) -> Path:
    """Write the folder, whole or not at all.

    Args:
        policy: what the policy file holds; its guard, which need not be the file's, is written into the entry.
        source: the policy file.
        folder: a new or empty folder.
        username: who is named on the leaderboard.
        name: the entry's name there.

    Returns:
        The entry's file, ``con_NAME.py``.
    """
    check_export_name(name)
    if not username.isprintable() or any(sign in username for sign in '"\\,') or not 0 < len(username) <= 60:
        raise SwingupError(
            f"username {quoted(username)} does not fit an entry: use up to 60 letters, no quotes or commas"
        )
    texts = {
        f"con_{name}.py": _entry(policy, username, name),
        f"readmes/{name}.md": fill(asset(__package__, "readme.md"), readme_values(policy, name)),
    }
    return write_folder(folder, name, "realaigym", source, texts) / f"con_{name}.py"


def write_folder(folder: str | Path, name: str, interface: str, source: Path, texts: Mapping[str, str]) -> Path:
    """Write the source, the policy and some texts, whole or not at all.

    Args:
        folder: a new or empty folder.
        name: name of the entry, which the copied source gets as well.
        interface: module of this package with the controller that the entry loads.
        source: the policy file.
        texts: contents by their paths in the folder.

    Returns:
        The folder.
    """
    target, root = Path(folder).resolve(), resources.files("swingup")
    if target.exists() and (not target.is_dir() or any(target.iterdir())):
        raise SwingupError(f"{folder} is there already: name a folder that is new or empty")
    try:
        # On the target's file system, where the final move is a rename: the folder appears whole or not at all.
        with tempfile.TemporaryDirectory(dir=target.parent, prefix=f".{target.name}.") as temporary:
            made = Path(temporary) / target.name
            package = made / PACKAGE.format(name=name)
            for file in (*_sources(root), "export/__init__.py", f"export/{interface}.py"):
                _write(package / file, root.joinpath(*file.split("/")).read_bytes())
            _write(package / "__init__.py", ABOUT.encode())
            _write(package / "policy.safetensors", source.read_bytes())
            for path, text in texts.items():
                _write(made / path, text.encode())
            # Empty, as tested above. The move would otherwise go inside it.
            if target.exists():
                target.rmdir()
            shutil.move(made, target)
    except OSError as error:
        reason = error.strerror or error
        raise SwingupError(
            f"cannot write {folder}: {reason}; choose a place that exists and can be written"
        ) from error
    return target


def _sources(root: Traversable) -> list[str]:
    """Paths of what a controller needs of this package, besides its interface."""
    found, folders = list(COMMON), ["plant", "policy"]
    for folder in folders:
        for each in (root / folder).iterdir():
            path = f"{folder}/{each.name}"
            if each.is_dir():
                # The loop goes on with it.
                folders.append(path)
            elif path.endswith(".py"):
                found.append(path)
    return found


def _write(path: Path, content: bytes) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(path, content)


def _entry(policy: PendulumPolicy, username: str, name: str) -> str:
    behind = " behind a state estimator" if policy.estimator else ""
    made, method = "Average-reward maximum-entropy RL (AR-EAPO): one network", "AR-EAPO"
    if policy.regulator:
        made, method = "One network distilled from teachers (one by AR-EAPO) with a regulator", "distilled"
    values = {
        "DESCRIPTION": f"{made}{behind}",
        "NAME": name,
        "PACKAGE": PACKAGE.format(name=name),
        "ROBOT": policy.robot.name,
        "GUARD": guard_entry(policy.guard),
        "METHOD": method,
        "USERNAME": username,
        "VERSION": __version__,
    }
    return fill(asset(__package__, "con_swingup.py.txt"), values)


def guard_entry(guard: GuardSettings | None) -> str:
    """A guard's settings as an entry holds them, in Python, for its owner to read and to change."""
    if guard is None:
        return "False"
    # Python has JSON's numbers; of its words, null alone occurs here.
    return json.dumps(asdict(guard), indent=4).replace("null", "None").replace("\n}", ",\n}")


def readme_values(policy: PendulumPolicy, name: str) -> dict[str, str]:
    """What a folder's README says of its policy, for the gaps of a template."""
    command = policy.metadata.get("command")
    base = " and the pendulum's base parameters" if policy.identifier else ""
    seen = (
        f"an estimate of the state by a Kalman filter, which also finds the loop's delay{base}"
        if policy.estimator
        else "the measured state"
    )
    return {
        "ESTIMATOR": f"It is shown {seen}.",
        "GUARD": GUARDED if policy.guard else UNGUARDED,
        "JOINT": ("shoulder", "elbow")[policy.robot.joint],
        "KIND": f"A network distilled from teachers, one of which is a {BY_AREAPO}"
        if policy.regulator
        else f"A {BY_AREAPO}",
        "LAYERS": " and ".join(str(len(layer.bias)) for layer in policy.network.trunk),
        "TORQUE": _torque(policy),
        "NAME": name,
        "ORIGIN": f"- The policy file was made by `{command}`." if isinstance(command, str) else "",
        "PACKAGE": PACKAGE.format(name=name),
        "RATE": f"one call every {policy.period:g} s" if policy.period else "any; 500 Hz on the leaderboards",
        "ROBOT": policy.robot.name,
        "SWITCHED": (
            "near upright a linear-quadratic regulator takes over"
            if policy.regulator
            else "nothing is switched, tracked or planned"
        ),
        "VERSION": __version__,
    }


def _torque(policy: PendulumPolicy) -> str:
    most, joints = f"at most {policy.torque_limit:g} N m", ("shoulder", "elbow")
    joint, passive = joints[policy.robot.joint], joints[1 - policy.robot.joint]
    if policy.identifier is None:
        return f"{most}, on the {joint} alone"
    return (
        f"{most} on the {joint}, and compensation of friction: there, and within "
        f"{policy.identifier.passive_limit:g} N m on the {passive}"
    )
