"""Whether numbers describe a double pendulum; without JAX, for policy files as for parameter files."""

from collections.abc import Mapping
from types import SimpleNamespace

from ..errors import SwingupError
from .equations import lump, mass_entries


def check_pendulum(values: Mapping[str, float]) -> None:
    """Refuse parameters, finite numbers by RealAIGym's names, that make no pendulum.

    Negative friction and inertias below m r² are allowed: the robustness benchmark contains both.

    Raises:
        SwingupError: a mass, length or g is not positive, a torque limit is negative, or the mass matrix is not
            positive definite in every configuration.
    """
    for name in ("m1", "m2", "l1", "l2", "g"):
        if values[name] <= 0:
            raise SwingupError(f"parameter {name} = {values[name]:g} must be positive")
    for name in ("tl1", "tl2"):
        if values[name] < 0:
            raise SwingupError(f"parameter {name} = {values[name]:g} must not be negative")
    # det M is concave in cos(q2), so that its least value lies at cos(q2) = 1 or -1.
    for cos_q2 in (1.0, -1.0):
        m11, m12, m22 = mass_entries(lump(SimpleNamespace(**values)), cos_q2)
        if not (m22 > 0 and m11 * m22 - m12 * m12 > 0):
            raise SwingupError(
                f"mass matrix is not positive definite at cos(q2) = {cos_q2:g}: "
                f"raise I1 = {values['I1']:g} or I2 = {values['I2']:g}"
            )
