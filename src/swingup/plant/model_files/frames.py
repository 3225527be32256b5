"""Frames in space: rotations from the ways in which model files write them."""

import math
from typing import NamedTuple, TypeAlias

import numpy as np

from ...common.errors import SwingupError, quoted
from ...common.xml_tree import Attributes

Vector: TypeAlias = np.ndarray
"""Three numbers."""

AXES = dict(zip("xyz", np.eye(3), strict=True))


class Frame(NamedTuple):
    """Where a frame lies in another one."""

    rotation: np.ndarray = np.eye(3)
    origin: Vector = np.zeros(3)

    def point(self, place: Vector) -> Vector:
        """A point of this frame, in the other one."""
        return self.origin + self.rotation @ place

    def within(self, outer: "Frame") -> "Frame":
        """This frame, in that of the other one."""
        return Frame(outer.rotation @ self.rotation, outer.point(self.origin))


def turn(axis: Vector, angle: float) -> np.ndarray:
    """The rotation by an angle (rad) about a unit vector, by Rodrigues' formula."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * (cross @ cross)


def unit(vector: Vector, where: str) -> Vector:
    """A vector of length 1."""
    length = float(np.linalg.norm(vector))
    if not length > 0:
        raise SwingupError(f"{where} has a direction of length 0")
    return vector / length


def turn_onto(direction: Vector) -> np.ndarray:
    """The smallest rotation that turns z into a direction, a unit vector."""
    axis = np.cross(AXES["z"], direction)
    sine = float(np.linalg.norm(axis))
    # Parallel or opposite: any axis across z will do.
    if sine < 1e-12:
        return turn(AXES["x"], 0.0 if direction[2] > 0 else math.pi)
    return turn(axis / sine, math.atan2(sine, float(direction[2])))


def rpy_frame(origin: Attributes) -> Frame:
    """The frame of URDF's ``<origin xyz rpy>``: turned about the fixed axes x, y and z in this order."""
    angles = origin.numbers("rpy", (0, 0, 0))
    x, y, z = (turn(AXES[axis], angle) for axis, angle in zip("xyz", angles, strict=True))
    return Frame(z @ y @ x, origin.numbers("xyz", (0, 0, 0)))


TURNS = ("quat", "axisangle", "euler", "xyaxes", "zaxis")
"""MJCF's ways to write a rotation, of which an element has one."""


def mjcf_rotation(given: Attributes, degree: float, sequence: str) -> np.ndarray:
    """The rotation that an element of MJCF has.

    Angles are in units of ``degree`` (rad). In a sequence of Euler angles small letters turn with the body,
    capitals stay.
    """
    where = given.where
    if "quat" in given.values:
        # MuJoCo normalises quaternions, too.
        w, *vector = unit(given.numbers("quat", (1, 0, 0, 0)), where)
        sine = float(np.linalg.norm(vector))
        return turn(np.array(vector) / (sine or 1.0), 2 * math.atan2(sine, w))
    if "axisangle" in given.values:
        *axis, angle = given.numbers("axisangle", (0, 0, 1, 0))
        return turn(unit(np.array(axis), where), degree * angle)
    if "euler" in given.values:
        found = np.eye(3)
        if len(sequence) != 3 or not {*sequence.lower()} <= {*AXES}:
            raise SwingupError(f"<compiler> has eulerseq = {quoted(sequence)}: write three of x, y, z, X, Y, Z")
        for name, size in zip(sequence, given.numbers("euler", (0, 0, 0)), strict=True):
            turned = turn(AXES[name.lower()], degree * size)
            # Axes that turn with the body multiply from the right, fixed ones from the left.
            found = found @ turned if name.islower() else turned @ found
        return found
    if "xyaxes" in given.values:
        axes = given.numbers("xyaxes", (1, 0, 0, 0, 1, 0))
        x = unit(axes[:3], where)
        y = unit(axes[3:] - (axes[3:] @ x) * x, where)
        return np.column_stack([x, y, np.cross(x, y)])
    return turn_onto(unit(given.numbers("zaxis", (0, 0, 1)), where))
