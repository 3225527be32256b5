"""Baselines that are designed for other plants."""

import dataclasses
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import swingup
from swingup.control import baselines
from swingup.control.baselines import baseline, compute_score_reference, design_of
from swingup.control.model import model_of
from swingup.control.optimal import OPTIMAL
from swingup.control.own_units import scaled_optimal, scaled_published
from swingup.control.published import PUBLISHED
from swingup.control.reference import Reference
from swingup.control.search import SEARCH, follow, guesses, search
from swingup.control.transition import PendulumTransition
from swingup.errors import SwingupError
from swingup.physics.angles import UPRIGHT
from swingup.physics.plant import LEADERBOARD, load_plant
from swingup.physics.units import Scales, scales_of
from swingup.robots import get_robot

ONE = Scales(1.0, 1.0, 1.0, 1.0)


def test_the_settings_on_c1_are_the_published_ones(robot):
    published = PUBLISHED[robot.name]
    scaled = scaled_published(published, ONE)
    swingup_ = dataclasses.replace(
        scaled.swingup, search=None, settings=published.swingup.settings, steps=published.swingup.steps
    )
    assert dataclasses.replace(scaled, swingup=swingup_) == published
    # 1.8 s and 2 s are whole numbers of coarse steps up to rounding.
    scaled = scaled_optimal(OPTIMAL[robot.name], ONE)
    assert scaled.swingup.duration == pytest.approx(OPTIMAL[robot.name].swingup.duration)
    same = dataclasses.replace(scaled.swingup, duration=OPTIMAL[robot.name].swingup.duration)
    assert dataclasses.replace(scaled, swingup=same) == OPTIMAL[robot.name]


def test_a_plant_like_the_leaderboards_has_the_shipped_design(robot):
    assert design_of(robot, load_plant("C.1").frictionless()).shipped
    assert not design_of(robot, "C.1").shipped


def test_a_similar_pendulum_gets_a_similar_regulator(robot, similar):
    """T × 0.5 and torques × 0.025: gains on angles × 0.025, on velocities × 0.0125; the cost-to-go has one T."""
    plant = LEADERBOARD.driven(robot)
    gains = [np.asarray(baseline("lqr", robot, each).gains) for each in (None, similar(plant))]
    np.testing.assert_allclose(gains[1], gains[0] * [0.025, 0.025, 0.0125, 0.0125], rtol=1e-8)
    assert baseline("lqr", robot, similar(plant)).max_cost_to_go == pytest.approx(500)


def test_coulomb_friction_stays_out_of_the_model(robot):
    real = load_plant("C.1").driven(robot)
    model = model_of("C.1", robot)
    assert (model.cf1, model.cf2) == (0.0, 0.0)
    assert (model.b1, model.Ir) == (real.b1, real.Ir)


def test_a_swingup_for_the_score_gets_longer_until_it_comes_up(robot, monkeypatch):
    durations = []

    def computed(robot, problem, seed, plant):
        durations.append(problem.duration)
        end = UPRIGHT if len(durations) == 2 else np.zeros(4)
        return SimpleNamespace(states=np.stack([np.zeros(4), end]), torque=np.zeros(1)), {"seed": seed}

    monkeypatch.setattr(baselines, "compute_optimal_reference", computed)
    design = design_of(robot, "C.0")
    assert compute_score_reference(design, 3)[1] == {"seed": 3}
    first = design.optimal.swingup.duration
    assert durations == pytest.approx([first, 1.5 * first], abs=design.optimal.swingup.coarse_dt)
    # The leaderboards' plant keeps the one duration that was chosen for it.
    durations[:] = []
    compute_score_reference(design_of(robot, None), 3)
    assert durations == pytest.approx([OPTIMAL[robot.name].swingup.duration])


@pytest.mark.slow
def test_a_search_comes_up_and_a_finer_grid_follows_it(x64):
    robot, plant = get_robot("acrobot"), load_plant("C.0").frictionless()
    problem = design_of(robot, plant).published.swingup
    settings = dataclasses.replace(problem.search, starts=1)
    transition = PendulumTransition(
        model_of(plant, robot), robot.joint, problem.dt * problem.steps / settings.steps
    )
    found = search(transition, problem.cost(settings.steps), settings, seed=0)
    assert found.miss < 0.05
    fine = PendulumTransition(model_of(plant, robot), robot.joint, problem.dt)
    torque = follow(found, fine, problem.cost(problem.steps), 5.0, problem.steps)
    assert np.abs(torque).max() <= 5.0
    # The first states agree: the last of them has been reached by a tenth of all torques.
    step, x, rows = jax.jit(lambda x, u: fine.step(x, u)), (0.0, 0.0, 0.0, 0.0), problem.steps // 10
    for u in torque[:rows]:
        x = step(x, u)
    np.testing.assert_allclose(x, found.states[settings.steps // 10], atol=0.02)


def test_guesses_repeat_and_differ():
    assert np.array_equal(guesses(SEARCH, 1), guesses(SEARCH, 1))
    assert not np.array_equal(guesses(SEARCH, 1), guesses(SEARCH, 2))
    assert not guesses(SEARCH, 1)[:, -SEARCH.steps // 5 :].any()


def drawn_plant(seed):
    """A pendulum with 0.1 to 10 times C.1's masses, lengths and torque limits."""
    plant, random = load_plant("C.1"), np.random.default_rng(seed)
    mass1, mass2, length1, length2, torque = 10 ** random.uniform(-1, 1, 5)
    factors = {
        "m1": mass1, "m2": mass2, "l1": length1, "r1": length1, "l2": length2, "r2": length2,
        "I1": mass1 * length1**2, "I2": mass2 * length2**2, "tl1": torque, "tl2": torque,
    }  # fmt: skip
    return dataclasses.replace(plant, **{name: getattr(plant, name) * by for name, by in factors.items()})


@pytest.mark.parametrize(
    ("name", "seeds"),
    [
        ("lqr", 4), ("tvlqr", 4), ("ilqr-riccati", 4), ("tvlqr-score", 2),
        pytest.param("ilqr-mpc", 1, marks=pytest.mark.slow),  # it compiles for 20 s
    ],
)  # fmt: skip
def test_baselines_command_what_the_plants_own_motor_has_and_no_more(name, seeds, robot, x64, monkeypatch):
    def resting(robot, *_):
        rows = np.zeros((400, 4))
        return Reference(robot, 0.001, rows, rows[:, 0], np.ones_like(rows))

    # Any trajectory does: a swing-up takes a minute to compute.
    monkeypatch.setattr(baselines, "_computed_reference", resting)
    for plant in map(drawn_plant, range(seeds)):
        limit = (plant.tl1, plant.tl2)[robot.joint]
        controller = baseline(name, robot, plant)
        random = np.random.default_rng(0)
        # From errors that hardly count to those that ask for more than any motor has; near upright for the LQR.
        sizes = 10 ** random.uniform(-4, 5, (2000, 1)) * [1, 1, 1, 1]
        states = UPRIGHT * (name == "lqr") + sizes * random.normal(size=(2000, 4)) * [name != "lqr", 1, 1, 1]
        call = jax.vmap(lambda x, c=controller: c(c.init(), jnp.zeros(()), x)[1])
        torques = np.asarray(jax.jit(call)(jnp.asarray(states)))
        assert np.abs(torques[:, robot.joint]).max() == limit
        assert not torques[:, 1 - robot.joint].any()


def test_a_motor_without_torque_is_refused():
    weak = dataclasses.replace(load_plant("B.0"), tl2=0.0)
    with pytest.raises(SwingupError, match="the acrobot's motor has a torque limit of 0: raise tl2"):
        baseline("lqr", "acrobot", weak)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["tvlqr", "ilqr-mpc", "tvlqr-score"])
def test_baselines_swing_up_other_plants(name):
    plant = load_plant("C.0").frictionless()
    assert scales_of(plant).time == pytest.approx(0.971, abs=1e-3)
    assert swingup.evaluate(baseline(name, "acrobot", plant), "acrobot", plant=plant).criteria.success
