"""A domain around an identified plant."""

import contextlib
from collections.abc import Mapping
from typing import Any

from ..common.errors import SwingupError
from ..loop.domain import make_domain
from ..plant.plant import Plant
from .fit.prediction import LEAST_LAG

Range = tuple[float, float]


def domain_of(plant: Plant, ranges: Mapping[str, Range], others: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """A domain's content: ranges of plant and loop around an identified plant.

    Where corners of wide ranges do not make a pendulum, all ranges are narrowed together until they do. Ranges are
    of the base parameters, ``delay`` and ``lag`` (s); instead of A, of I1 + m2 l1² = A - B. Other entries stay as
    they are: offsets, quanta, torque gains, and where velocities come from.
    """
    for narrowing in (1.0, 0.7, 0.5, 0.3, 0.15):
        content = {**_content(plant, ranges, narrowing), **(others or {})}
        with contextlib.suppress(SwingupError):
            make_domain(content)
            return content
    content = {**_content(plant, ranges, 0.0), **(others or {})}
    make_domain(content)
    return content


def _content(p: Plant, ranges: Mapping[str, Range], narrowing: float) -> dict[str, float | list[float]]:
    first, second, shoulder, elbow = (ranges[name] for name in ("k", "m2r2", "A", "B"))
    weight, inertia = float(p.m2 * p.l1), float(p.m2 * p.l1**2)
    # The masses stay: a range of a base parameter is one of the centre of mass or the inertia.
    spans: dict[str, Range] = {
        "r1": ((first[0] - weight) / float(p.m1), (first[1] - weight) / float(p.m1)),
        "r2": (second[0] / float(p.m2), second[1] / float(p.m2)),
        "I1": (shoulder[0] - inertia, shoulder[1] - inertia),
        "I2": elbow,
        **{name: ranges[name] for name in ("Ir", "b1", "b2", "cf1", "cf2")},
    }
    kept = ("m1", "m2", "l1", "l2", "gr", "g")
    content: dict[str, float | list[float]] = {name: float(getattr(p, name)) for name in kept}
    for name, (low, high) in spans.items():
        value = float(getattr(p, name))
        content[name] = [value + narrowing * min(low - value, 0.0), value + narrowing * max(high - value, 0.0)]
    content["torque_limit"] = float(max(p.tl1, p.tl2))
    # Measured torques may be later than those that act, which a fit sees as a delay below 0. A loop has none.
    content["delay"] = [max(end, 0.0) for end in ranges["delay"]]
    content["lag"] = [max(end, LEAST_LAG) for end in ranges["lag"]]
    return content
