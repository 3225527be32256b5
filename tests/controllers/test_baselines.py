import jax
import jax.numpy as jnp
import numpy as np
import pytest

import swingup
from swingup.controllers.baselines.baselines import BASELINES, baseline

LEAST_SCORES = {
    ("tvlqr", "acrobot"): 0.50, ("tvlqr", "pendubot"): 0.52,
    ("ilqr-riccati", "acrobot"): 0.39, ("ilqr-riccati", "pendubot"): 0.53,
}  # fmt: skip
SWINGUP_TIME = {"acrobot": 4.05, "pendubot": 4.13}


def test_scores(either_robot):
    robot = either_robot
    for name in ("tvlqr", "ilqr-riccati"):
        criteria = swingup.judge(baseline(name, robot), robot).criteria
        assert criteria.score >= LEAST_SCORES[name, robot.name]
        assert criteria.swingup_time == pytest.approx(SWINGUP_TIME[robot.name], abs=0.02)


@pytest.mark.slow
def test_score_of_the_mpc(robot):
    criteria = swingup.judge(baseline("ilqr-mpc", robot), robot).criteria
    assert criteria.score >= {"acrobot": 0.34, "pendubot": 0.35}[robot.name]


def test_they_balance_upright(either_robot):
    robot = either_robot
    # The first call at the goal latches all of them to the same LQR.
    x = jnp.array([np.pi + 0.01, -0.01, 0.02, -0.02])
    with jax.enable_x64(True):
        found = [baseline(name, robot) for name in ("lqr", "tvlqr", "ilqr-riccati")]
        answers = [
            np.asarray(each(each.init(), jnp.asarray(1.0), jnp.asarray(x, jnp.float64))[1]) for each in found
        ]
    np.testing.assert_allclose(answers, np.tile(answers[0], (3, 1)), rtol=1e-12)
    assert answers[0][1 - robot.joint] == 0.0
    assert 0 < abs(answers[0][robot.joint]) < 6.0


def test_they_keep_double_precision_and_know_their_robot(robot):
    for controller in (baseline(name, robot) for name in BASELINES):
        assert controller.robot == robot
        for leaf in jax.tree.leaves(controller):
            assert isinstance(leaf, float) or (isinstance(leaf, np.ndarray) and leaf.dtype == np.float64)
