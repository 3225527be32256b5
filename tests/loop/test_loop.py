"""The robot's own loop, element by element, against numbers derived by hand."""

import dataclasses
import functools
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from swingup.benchmark.rollout import Scenario, apply_torque, initial_loop, measure
from swingup.dynamics.dynamics import UPRIGHT
from swingup.loop import disturbance as effects
from swingup.loop.disturbance import (
    Effects,
    Pushes,
    Times,
    measured_state,
    motor_torques,
    step_noise,
    step_period,
    undisturbed,
)
from swingup.loop.draw import draw
from swingup.loop.loop import LONGEST_PERIOD, Loop
from swingup.loop.resolve import PLANT, SESSIONS, resolve
from swingup.loop.starts import PASSING, Starts, sample_starts
from swingup.plant.files import load_plant
from swingup.plant.plant import LEADERBOARD, get_robot
from swingup.plant.units import scales_of

DT = 0.002
SHIFTED = Loop(quantum1=0.5, offset1=0.1, offset2=-0.2)
draw_one = jax.jit(draw, static_argnums=(0, 2))


def array(*numbers):
    return np.array(numbers)


def test_angles_and_velocities():
    """1.2 + 0.1 is 2.6 steps of 0.5, so 3; the second joint has no step. From 0.9 + 0.1 = 2 steps 0.1 s before:
    5 rad/s; from -0.3 to 0.1: 4 rad/s. Or the true ones.
    """
    now, before = jnp.array([1.2, 0.3, 7.0, 8.0]), jnp.array([0.9, -0.1, 0.0, 0.0])
    seen = [effects.sensed(SHIFTED, differences, now, before, 0.1) for differences in (True, False)]
    np.testing.assert_allclose(seen, [[1.5, 0.1, 5.0, 4.0], [1.5, 0.1, 7.0, 8.0]], rtol=1e-5)


def test_differences_are_over_recorded_times_and_as_old_as_the_measurement():
    """Steps 0 to 3 at 0, 2, 5 and 9 ms: one period late, step 3 sees step 2 and the 3 ms before it."""
    delayed = dataclasses.replace(undisturbed(), delay_steps=1)
    disturbance = dataclasses.replace(delayed, effects=Effects(sensors=True, differences=True))
    assert disturbance.is_timed
    times, past = effects.start_times(3, DT, jnp.dtype("float32")), jnp.zeros((3, 4))
    seen = []
    for step, (now, q) in enumerate([(0.0, 0.0), (0.002, 0.1), (0.005, 0.4), (0.009, 0.9)]):
        times = Times(jnp.asarray(now), times.past).remember(step)
        past = past.at[step % 3].set(jnp.array([q, -q, 0.0, 0.0]))
        seen.append(measured_state(disturbance, past, step, jnp.zeros(2), times))
    np.testing.assert_allclose(seen[0], np.zeros(4))  # before the run: at rest
    np.testing.assert_allclose(seen[2], [0.1, -0.1, 50.0, -50.0], rtol=1e-4)
    np.testing.assert_allclose(seen[3], [0.4, -0.4, 100.0, -100.0], rtol=1e-4)


def test_late_periods():
    """Half of the periods are late: a draw of 0.25 is at the half of them, whose excess is ln 2 of the mean."""
    loop = Loop(late=0.5, lateness=0.001)
    found = jax.jit(lambda u: effects.late_period(loop, u, DT))(np.float32([0.25, 0.5, 0.9, 0.0]))
    np.testing.assert_allclose(found, [DT + 0.001 * math.log(2), DT, DT, LONGEST_PERIOD * DT], rtol=1e-5)
    assert float(effects.late_period(Loop(lateness=0.001), jnp.asarray(0.0), DT)) == pytest.approx(DT)
    late = dataclasses.replace(undisturbed().changed(late=0.1, lateness=0.0005), effects=Effects(late=True))
    period = jax.jit(jax.vmap(lambda k: step_period(late, k, DT, jnp.dtype("float32"))))
    # 2,000 late ones, give or take 42; their excess is cut at 4 ms, where exp(-8) are left.
    excess = np.asarray(period(np.arange(20_000))) - DT
    excess = excess[excess > 1e-4 * DT]
    assert (len(excess) / 20_000, excess.mean()) == pytest.approx((0.1, 0.0005), rel=0.12)
    assert step_period(undisturbed(), 3, DT, jnp.dtype("float32")) == DT


def test_a_lag_is_an_exponential_with_its_impulse():
    """After one time constant 1/e is missing, and (1 - 1/e) of the change on the mean of that time."""
    mean, after = effects.lagging(Loop(lag=DT), jnp.array([6.0, 0.0]), jnp.array([0.0, 3.0]), DT)
    np.testing.assert_allclose(after, [6 - 6 / math.e, 3 / math.e], rtol=1e-6)
    np.testing.assert_allclose(mean, [6 / math.e, 3 * (1 - 1 / math.e)], rtol=1e-6)

    # All in all the impulse lags by lag times the change.
    torque, missing = jnp.zeros(2), 0.0
    for _ in range(30):
        mean, torque = effects.lagging(Loop(lag=0.003), jnp.array([6.0, 0.0]), torque, DT)
        missing += DT * float(6.0 - mean[0])
    assert missing == pytest.approx(0.003 * 6.0, rel=1e-5)
    for torque in effects.lagging(Loop(), jnp.array([6.0, 0.0]), jnp.zeros(2), DT):
        np.testing.assert_allclose(torque, [6.0, 0.0], atol=1e-4)


def test_gains_act_on_commands_and_pushes_alike():
    """Asked: 9 N m cut to 6 and a push of 1; the passive motor, of limit 0, has its push of 2. Gains 0.8, 0.5."""
    pushes = Pushes(np.zeros((2, 1)), np.ones((2, 1)), array([1.0], [2.0]))
    weak = undisturbed().changed(gain1=0.8, gain2=0.5)
    disturbance = dataclasses.replace(weak, pushes=pushes, effects=Effects(drive=True))
    args = (jnp.array([9.0, 9.0]), jnp.zeros(2), jnp.zeros(()), jnp.full(2, 0.1), array(6.0, 0.0), jnp.zeros(4), DT)
    acting, own = motor_torques(disturbance, *args)
    np.testing.assert_allclose(acting, [0.8 * 7.0 + 0.1, 0.5 * 2.0], rtol=1e-4)  # noise where a motor is driven
    np.testing.assert_allclose(own, [7.0, 2.0], rtol=1e-4)  # the motor knows nothing of its gain
    limited = dataclasses.replace(disturbance.changed(rate_limit=500.0), effects=Effects(motors=True, drive=True))
    np.testing.assert_allclose(motor_torques(limited, *args)[1], [1.0, 1.0], rtol=1e-4)  # 500 N m/s for 2 ms


LIMITS = array(6.0, 0.5)
CALM = dataclasses.replace(undisturbed(), effects=Effects(motors=True))


@functools.partial(jax.jit, static_argnums=4)
def torques(disturbance, command, q, noise, steps):
    """What acts, and the motors' own, in steps of 2 ms at fixed angles with command and noise held."""

    def step(motors, k):
        x = jnp.concatenate([q, jnp.zeros(2)])
        acting, motors = motor_torques(disturbance, command, motors, k * DT, noise, LIMITS, x, DT)
        return motors, (acting, motors)

    return jax.lax.scan(step, jnp.zeros(2), jnp.arange(steps))[1]


def test_ripple_and_noise_at_rest_do_not_integrate():
    """A slow motor with 10 N m/s and a command of 0: its own torque stays 0, whatever acts beside it."""
    disturbance = CALM.changed(response=0.5, rate_limit=10.0, ripple=0.1)
    q = jnp.array([math.pi / 72, -math.pi / 72])  # a quarter of a period
    acting, own = torques(disturbance, jnp.zeros(2), q, jnp.full(2, 0.02), 10)
    np.testing.assert_allclose(acting, [[0.12, -0.08]] * 10, rtol=1e-6)
    np.testing.assert_array_equal(own, 0.0)


def test_a_push_adds_to_a_motor_that_hardly_moves():
    """At 10 N m/s each gains 0.02 N m a step: the first is asked for 6 N m, the other, of limit 0.5 N m, for -6."""
    pushes = Pushes(np.full((2, 1), 0.01), np.full((2, 1), 0.01), np.array([[1.0], [0.0]]))
    disturbance = dataclasses.replace(CALM.changed(rate_limit=10.0), pushes=pushes)
    acting, _ = torques(disturbance, jnp.array([6.0, -6.0]), jnp.zeros(2), jnp.zeros(2), 400)
    k = np.arange(400)
    push = np.exp(-0.5 * ((0.002 * k - 0.01) / 0.01) ** 2)
    np.testing.assert_allclose(acting[:, 0], np.minimum(0.02 * (k + 1), 6.0) + push, rtol=1e-4)
    np.testing.assert_allclose(acting[:, 1], np.maximum(-0.02 * (k + 1), -0.5), rtol=1e-4)


def test_each_motor_has_its_own_noise():
    disturbance = CALM.changed(torque_noise=0.5)
    noise = jax.jit(jax.vmap(lambda k: step_noise(disturbance, k, jnp.dtype("float32"))[1]))(jnp.arange(5000))
    # Standard errors of 5,000 draws: deviations 0.005, the correlation 0.014.
    np.testing.assert_allclose(noise.std(axis=0), 0.5, atol=0.025)
    assert abs(float(np.corrcoef(noise.T)[0, 1])) < 0.07


def test_loads_on_the_joints():
    """0.03 N m/rad at π and 0.1 N m; static friction as it fades: 1/e at 0.05 rad/s, none at 5."""
    loop = Loop(spring1=0.03, load1=0.1, stiction2=0.2)
    slow, fast = (effects.joint_loads(loop, array(np.pi, 1.0, 0.0, rate)) for rate in (0.05, 5.0))
    np.testing.assert_allclose(slow, [-0.03 * np.pi - 0.1, -0.2 / np.e * np.arctan(5.0)], rtol=1e-6)
    np.testing.assert_allclose(fast, [-0.03 * np.pi - 0.1, 0.0], atol=1e-7)


def test_the_elbows_encoder_leads_its_link():
    """5 N m wind 1/800 rad/(N m) up, and half of the play of 2 mrad is left behind."""
    loop, x = Loop(compliance2=1 / 800, backlash2=0.002), array(0.1, 0.2, 1.0, 2.0)
    np.testing.assert_allclose(
        effects.motor_side(loop, jnp.array(x), -5.0), x - [0.0, 5 / 800 + 0.001, 0.0, 0.0], rtol=1e-6
    )


def test_a_sagging_supply_takes_torque_from_driving_motors_alone():
    limits, rates = array(6.0, 0.5), array(10.0, -10.0)
    found = [effects.sagging_limits(Loop(sag=0.1), limits, array(*u), rates) for u in ((1.0, -1.0), (-1.0, 1.0))]
    np.testing.assert_allclose(found, [[5.0, 0.0], [6.0, 0.5]], atol=1e-6)


def test_gaps_in_the_samples():
    """Ten a second of 6 ms, from a fifth of their cycle on: samples 40 to 42 of the first 50 are the 39th."""
    loop = Loop(dropouts=10.0, dropout=0.006)
    held = jax.jit(jax.vmap(lambda k: effects.held_steps(loop, k, jnp.array(0.2), DT)))(np.arange(50))
    assert held.tolist() == [*[0] * 40, 1, 2, 3, *[0] * 7]
    assert not effects.held_steps(Loop(dropout=0.1), jnp.array(0), jnp.array(0.0), DT)


def test_a_run_with_every_effect():
    """Switched on they act, in each their own way; a run of defaults beside it is that without them."""
    values = {
        "spring1": 0.1, "backlash2": 0.01, "sag": 1.0, "period": 0.004, "dropouts": 50.0, "dropout": 0.01,
        "spoilt": 1e-9, "quantum1": 1e-3,
    }  # fmt: skip
    domain = resolve(domain={"plant": "C.1", **values})
    _, disturbance = draw_one(domain, jax.random.key(0), get_robot("pendubot"))
    scenario = Scenario(domain.plant.driven(get_robot("pendubot")), disturbance, substeps=domain.substeps)

    @jax.jit
    def run(loop):
        def step(loop, k):
            loop, measured, _ = measure(scenario, loop, k)
            return apply_torque(scenario, loop, k, jnp.array([1.0, 0.0]), DT), measured

        return jax.lax.scan(step, loop, jnp.arange(20))

    loop, seen = run(initial_loop(scenario, jnp.array([0.3, 0.0, 0.0, 0.0]), domain.depth))
    assert float(loop.times.now) == pytest.approx(20 * 0.004)
    assert np.isfinite(seen).all()
    # Every 20 ms, five turns, a gap of two.
    assert sum(np.array_equal(one, other) for one, other in zip(seen[2:], seen[1:], strict=False)) in (7, 8)


def test_domains_have_the_effects_that_they_need():
    robot, motors = get_robot("acrobot"), Effects(motors=True)
    for name in ("identified", "randomised"):
        assert resolve(domain=name).effects == motors
    # A value decides, not its name.
    assert resolve(domain={"plant": "C.1", "lag": 0.0, "late": 0.0, "offset1": 0.0}).effects == motors
    lagging = resolve(domain={"plant": "C.1", "lag": 0.003, "gain2": 0.8, "passive_push": 2.0, "offset1": -0.1})
    with jax.enable_x64(True):
        _, found = draw_one(lagging, jax.random.key(0), robot)
    assert found.effects == Effects(motors=True, drive=True, sensors=True)
    numbers = [float(getattr(found.loop, name)) for name in ("lag", "gain1", "gain2", "offset1")]
    assert (numbers, lagging.depth) == ([0.003, 1.0, 0.8, -0.1], 1)
    peaks = np.asarray(found.pushes.amplitude)[:, 0]
    assert 0 < abs(float(peaks[0])) <= 2.0  # the acrobot's shoulder is passive
    assert float(peaks[1]) == 0.0
    late = {"plant": "C.1", "quantum1": 1e-3, "late": 0.1, "lateness": 1e-3}
    timed = resolve(domain=late | {"cf1": [0.04, 0.16], "cf2": [0.03, 0.12]})
    assert (timed.effects.differences, timed.depth) == (True, 2)
    # λ of C.1, the stiffest corner, is 1,132 a second, and the longest period 6 ms: 6.8 / 2.5; in the middle 4.2.
    assert timed.substeps == 3
    assert not resolve(domain={"plant": "C.1", "quantum1": 1e-3, "velocities": "driver"}).effects.differences


def test_sessions_have_facts():
    for domain in (resolve(domain=f"session-{name}") for name in SESSIONS):
        assert set(domain.names) >= {*PLANT, "delay", "lag", "quantum1", "offset2"}
        assert all(low == high for _, low, high in domain.ranges)


def test_the_recorded_ranges_are_as_wide_as_the_recordings():
    """Base parameters relative to the identified plant, where m2 and l1 keep their values."""
    domain = resolve(domain="recorded")
    ends = {name: array(low, high) for name, low, high in domain.ranges}
    base = domain.plant
    first = (ends["m1"] * ends["r1"] + base.m2 * base.l1) / (base.m1 * base.r1 + base.m2 * base.l1)
    widest = {
        "m1 r1 + m2 l1": (first, 0.87, 1.02), "m2 r2": (ends["r2"] / base.r2, 0.95, 1.05),
        "I2": (ends["I2"] / base.I2, 0.95, 1.05), "Ir": (ends["Ir"], 6e-5, 1.4e-4),
        "gain1": (ends["gain1"], 0.77, 1.0), "gain2": (ends["gain2"], 0.77, 1.0), "cf1": (ends["cf1"], 0.07, 0.16),
        "cf2": (ends["cf2"], 0.06, 0.125), "b1": (ends["b1"], 0.0, 0.012), "b2": (ends["b2"], 0.0, 0.012),
        "dead time": (ends["lag"] + ends["delay"], 0.003, 0.006), "quantum1": (ends["quantum1"], 3.81e-4, 3.81e-4),
    }  # fmt: skip
    for name, ((low, high), least, most) in widest.items():
        assert low <= least * (1 + 1e-3), name
        assert high >= most * (1 - 1e-3), name


COST_TO_GO = np.diag([400.0, 100.0, 25.0, 4.0])
STARTS = Starts(anywhere=2.0, near_top=1.0, passing=1.0, hanging=1.0)


def sample(plant):
    x = sample_starts(np.random.default_rng(0), plant.driven("acrobot"), STARTS, 5000, COST_TO_GO)
    return np.split(x, np.cumsum([2000, 1000, 1000]))


def test_each_kind_has_its_share_and_its_size():
    anywhere, near_top, passing, hanging = sample(LEADERBOARD)
    assert np.abs(anywhere[:, :2]).max() == pytest.approx(np.pi, abs=0.01)
    # With a deviation that is uniform up to 10 rad/s, the variance is 10² / 3.
    assert anywhere[:, 2:].std() == pytest.approx(10 / np.sqrt(3), rel=0.05)
    error = near_top - UPRIGHT
    costs = np.einsum("ni,ij,nj->n", error, COST_TO_GO, error)
    assert (costs.max(), costs.mean()) == pytest.approx((1.0, 0.5), abs=0.03)
    assert (passing - UPRIGHT).std(axis=0) == pytest.approx(PASSING, rel=0.1)
    assert hanging.std() == pytest.approx(0.05, rel=0.05)


def test_velocities_are_in_the_plants_own_units():
    small = load_plant("cloudpendulum")
    time = scales_of(small.driven("acrobot")).time
    for one, other in zip(sample(LEADERBOARD), sample(small), strict=True):
        # States near the top are those of the given cost-to-go on every plant.
        factor = 1.0 if np.allclose(one, other) else 1.0 / time
        np.testing.assert_allclose(other, one * [1.0, 1.0, factor, factor], rtol=1e-9)


def test_counts_add_up():
    counts = Starts(thrown=0.7, anywhere=0.15, hanging=0.15).counts(20_000)
    assert counts == dict(zip(counts, (14_000, 0, 3000, 0, 0, 3000), strict=True))
    assert sum(Starts(thrown=1.0, passing=1.0, hanging=1.0).counts(100).values()) == 100
