import jax
import jax.numpy as jnp
import numpy as np
import pytest

from swingup.tasks.observation import PendulumStage

PI = np.pi


@pytest.mark.parametrize(
    ("x", "expected"),
    # [(q1 mod 2π - π)/π, (q2 mod 2π - π)/π, dq1/20, dq2/20], velocities clipped to ±20 rad/s.
    [
        ((0, 0, 0, 0), (-1, -1, 0, 0)),  # hanging: 0 - π
        ((PI, 0, 0, 0), (0, -1, 0, 0)),  # upright
        ((PI / 2, 3 * PI / 2, 5, -10), (-0.5, 0.5, 0.25, -0.5)),
        ((-PI / 2, 2.5 * PI, 20, -20), (0.5, -0.5, 1, -1)),  # 3π/2 - π, and π/2 - π
        ((-PI, 7 * PI, 30, -1e4), (0, 0, 1, -1)),  # whole turns, clipped rates
        ((PI, -0.1, 0, 0), (0, 1 - 0.1 / PI, 0, 0)),  # below the jump at q2 = 0: 2π - 0.1 - π
        ((PI, 0.1, 0, 0), (0, -1 + 0.1 / PI, 0, 0)),  # above it
    ],
)
def test_wrapped_observation_by_hand(x, expected):
    observed = PendulumStage()(jnp.array(x, jnp.float32))
    np.testing.assert_allclose(observed, expected, atol=1e-6)


@pytest.mark.parametrize(
    ("x", "expected"),
    # [sin q1, cos q1, sin q2, cos q2, dq1/20, dq2/20]
    [
        ((0, 0, 0, 0), (0, 1, 0, 1, 0, 0)),
        ((PI, 0, 0, 0), (0, -1, 0, 1, 0, 0)),
        ((PI / 6, -PI / 2, 5, -30), (0.5, 0.75**0.5, -1, 0, 0.25, -1)),
        ((PI / 6 - 4 * PI, 2.5 * PI, 30, 20), (0.5, 0.75**0.5, 1, 0, 1, 1)),
    ],
)
def test_sincos_observation_by_hand(x, expected):
    observed = PendulumStage(angles="sincos")(jnp.array(x, jnp.float32))
    np.testing.assert_allclose(observed, expected, atol=2e-6)


def test_velocity_scale_clips_and_divides():
    observed = PendulumStage(velocity_scale=25.0)(jnp.array([0.0, 0.0, 5.0, -26.0]))
    np.testing.assert_allclose(observed[2:], [0.2, -1.0], rtol=1e-6)


@pytest.mark.parametrize(("angles", "size"), [("wrapped", 4), ("sincos", 6)])
def test_every_entry_lies_in_the_unit_interval(angles, size):
    # Among them angles so close below a whole turn that their remainder rounds to 2π.
    edges = [0, -1e-30, -1e-9, 2 * PI, -2 * PI, 1e6]
    angles_seen = np.concatenate([edges, np.random.default_rng(0).uniform(-50, 50, 1000)])
    x = np.stack([angles_seen, angles_seen, 10 * angles_seen, -10 * angles_seen], axis=1)
    observe = PendulumStage(angles=angles)
    observed = np.asarray(jax.vmap(observe)(jnp.array(x, jnp.float32)))
    assert observed.shape == (len(x), size)
    assert observe.size() == size
    assert np.abs(observed).max() <= 1.0


@pytest.mark.parametrize("angles", ["wrapped", "sincos"])
@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.usefixtures("x64")
def test_observation_has_the_dtype_of_the_state(angles, dtype):
    assert PendulumStage(angles=angles)(jnp.zeros(4, dtype)).dtype == dtype
