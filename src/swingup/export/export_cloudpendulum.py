"""A folder for CloudPendulum's client that needs NumPy alone: our source, the policy, an entry and a README."""

import dataclasses
from pathlib import Path

from ..policy.guard.settings import GuardSettings, default_guard
from ..policy.pendulum import PendulumPolicy
from .export_folder import guard_entry, readme_values, write_folder
from .template import NAME, asset, check_export_name, fill

CELL_VELOCITY = 50.0
"""Largest velocity of a joint (rad/s). Source: what teams report of the cells in 2026."""
CELL_TORQUE = 0.15
"""Largest torque (N m). Source: the same."""


def cloudpendulum_guard(period: float | None) -> GuardSettings:
    """The guard of a policy whose file has none, for calls every ``period`` s; None for every 2 ms."""
    return dataclasses.replace(default_guard(period), velocity_limit=CELL_VELOCITY)


def cloudpendulum_notes(policy: PendulumPolicy) -> list[str]:
    """What does not fit the cells in a policy, as sentences."""
    return [
        f"it may command {most:g} N m at the {joint}, and CloudPendulum's motors give {CELL_TORQUE:g}: train one "
        "for its plant"
        for joint, most in zip(("shoulder", "elbow"), policy.torque_limits, strict=True)
        if most > CELL_TORQUE
    ]


def export_cloudpendulum(policy: PendulumPolicy, source: Path, folder: str | Path, name: str = NAME) -> Path:
    """Write the folder, whole or not at all.

    Args:
        policy: what the policy file holds; its guard, which need not be the file's, is written into the entry.
        source: the policy file.
        folder: a new or empty folder.
        name: the entry's name.

    Returns:
        The entry, ``controller_NAME.py``.
    """
    check_export_name(name)
    values = readme_values(policy, name)
    entry = values | {"GUARD": guard_entry(policy.guard)}
    texts = {
        f"controller_{name}.py": fill(asset(__package__, "controller_swingup.py.txt"), entry),
        "README.md": fill(asset(__package__, "cloudpendulum.md"), values),
    }
    return write_folder(folder, name, "cloudpendulum", source, texts) / f"controller_{name}.py"
