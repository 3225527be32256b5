import math

import numpy as np
import pytest

from swingup.drawing import DRIVEN, LINK_2, draw_frame

L1, L2 = 0.2, 0.3
SCALE = 400 / (2 * 1.15 * 0.5)  # pixels per metre: the picture is 2 * 1.15 (l1 + l2) wide
RED, BLUE = (np.array([*bytes.fromhex(colour[1:])]) for colour in (DRIVEN, LINK_2))
HANGING = [0.0, 0.0, 0.0, 0.0]


def pixel(frame, right, up):
    """The colour at a place relative to the shoulder (m)."""
    return frame[round(200 - up * SCALE), round(200 + right * SCALE)]


def red_columns(frame):
    return np.nonzero(np.all(np.abs(frame - RED.astype(float)) < 20, axis=2))[1]


def test_tip_is_where_the_angles_put_it():
    for q1, q2, tip in (
        (0.0, 0.0, (0.0, -0.5)),  # hanging
        (math.pi, 0.0, (0.0, 0.5)),  # upright
        (math.pi / 2, 0.0, (0.5, 0.0)),  # counter-clockwise from hanging is to the right
        (0.0, math.pi / 2, (0.3, -0.2)),  # only link 2 to the right, from the elbow
        (math.pi / 2, math.pi / 2, (0.2, 0.3)),  # the elbow's angle is relative to link 1
    ):
        frame = draw_frame([q1, q2, 0.0, 0.0], L1, L2)
        assert (frame.shape, frame.dtype) == ((400, 400, 3), np.uint8)
        np.testing.assert_array_equal(pixel(frame, *tip), BLUE)


@pytest.mark.parametrize(("driven", "place", "other"), [(0, (0, 0), (0, -L1)), (1, (0, -L1), (0, 0))])
def test_driven_joint_is_marked(driven, place, other):
    frame = draw_frame(HANGING, L1, L2, driven=driven)
    np.testing.assert_array_equal(pixel(frame, *place), RED)
    assert not np.array_equal(pixel(frame, *other), RED)
    assert red_columns(draw_frame(HANGING, L1, L2)).size == 0


def test_torque_is_an_arrow_that_turns_with_its_sign():
    left, right, small, none = (
        red_columns(draw_frame([math.pi, 0.0, 0.0, 0.0], L1, L2, torque=[0.0, u])) for u in (4.0, -4.0, 1.0, 0.0)
    )
    # The arrow starts above the joint at column 200: counter-clockwise leads to the left.
    assert left.mean() < 195
    assert right.mean() > 205
    assert none.size == 0 < small.size < left.size > 50
