"""Refining: what is drawn, the smooth score, gradients through whole episodes, imitation, recipes."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from swingup.areapo.networks import init_actor
from swingup.benchmark.evaluate import evaluate
from swingup.benchmark.rollout import Trajectory
from swingup.benchmark.rules import PERFORMANCE_RULES
from swingup.control.baselines import baseline
from swingup.errors import SwingupError
from swingup.physics.parameters import get_robot, leaderboard_parameters
from swingup.policy.jax_backend.controller import PolicyController, shipped_policy
from swingup.policy.jax_backend.observation import PendulumObservation
from swingup.policy.jax_backend.policy import Policy
from swingup.refine.analytic_policy_gradient import AnalyticPolicyGradient, PolicyGradientSettings, batch_cost
from swingup.refine.behaviour_cloning import CloningSettings, demonstrate, imitate
from swingup.refine.episodes import Draws, draw
from swingup.refine.objective import Measures, Weights, bound_adjoint, measure
from swingup.refine.recipe import Refinement, refine

RULES = PERFORMANCE_RULES["v2"]
ACROBOT = get_robot("acrobot")
FEW = Draws(nominal=2, model=3, pushed=2, measured=2, anywhere=1)
SHORT = PolicyGradientSettings(iterations=4, learning_rate=1e-3, duration=0.1)


def small(robot=ACROBOT, seed=0):
    actor = init_actor(jax.random.key(seed), 6, 1, (8, 8), -1.0)
    actor = eqx.tree_at(lambda a: a.mean_head.weight, actor, replace_fn=lambda w: 30 * w)
    return PolicyController(Policy((PendulumObservation(angles="sincos"),), actor), 6.0, robot)


def test_draws_are_of_the_kinds_asked_for_and_within_the_benchmark_s_ranges():
    draws = Draws(nominal=20, model=200, pushed=30, measured=60, anywhere=10, widen=1.1)
    episodes = draw(np.random.default_rng(0), ACROBOT, draws)
    plant, disturbed = episodes.scenario.parameters, episodes.scenario.disturbance
    nominal = leaderboard_parameters(ACROBOT)
    assert episodes.nominal.sum() == 20
    masses = plant.m2 / nominal.m2
    assert 0.725 - 1e-6 <= masses.min() < 0.8
    assert 1.2 < masses.max() <= 1.275 + 1e-6
    assert -0.22 <= plant.cf1.min() < 0 < plant.cf1.max() <= 0.22
    assert plant.Ir.min() == 0
    wrong = sum(~np.isclose(getattr(plant, name), getattr(nominal, name)) for name in vars(nominal))
    assert set(np.unique(wrong)) == {0, 1, 2}
    assert (wrong > 0).sum() <= 200
    assert (np.abs(disturbed.pushes.amplitude).max(axis=(1, 2)) > 0).sum() == 30
    amplitudes = np.abs(disturbed.pushes.amplitude[disturbed.pushes.amplitude != 0])
    assert amplitudes.min() >= 0.5
    assert amplitudes.max() <= 5.0
    assert 0 < disturbed.velocity_noise.max() <= 0.5
    assert 0 < disturbed.delay.max() <= 20
    assert episodes.x0.dtype == np.float32
    assert len(np.unique(disturbed.noise, axis=0)) == draws.episodes
    upright = np.abs(episodes.x0[:, 0] - np.pi) < 0.8
    assert 0.4 < upright.sum() / 260 < 0.8
    assert not upright[episodes.nominal].any()


def test_weak_draws_are_nominal_and_seeds_tell_draws_apart():
    draws = dataclasses.replace(FEW, upright=0.0)
    weak = draw(np.random.default_rng(0), ACROBOT, draws, strength=0.0)
    assert np.allclose(weak.scenario.parameters.m1, leaderboard_parameters(ACROBOT).m1)
    assert not weak.scenario.disturbance.pushes.amplitude.any()
    assert np.all(weak.scenario.disturbance.response == 1)
    one, same, other = (draw(np.random.default_rng(seed), ACROBOT, draws) for seed in (1, 1, 2))
    assert np.array_equal(one.x0, same.x0)
    assert not np.array_equal(one.x0, other.x0)


@pytest.mark.parametrize(
    "values", [{"nominal": -1}, {"nominal": 0, "model": 0, "pushed": 0, "measured": 0, "anywhere": 0}]
)
def test_draws_refuse_what_cannot_work(values):
    with pytest.raises(SwingupError):
        Draws(**values)


def test_the_smooth_score_is_nearly_the_judge_s(robot):
    result = evaluate(shipped_policy(robot)[0], robot)
    measures = measure(result.trajectory, leaderboard_parameters(robot), RULES.dt, RULES)
    # The smoothed line takes 0.7 % of the time upright for down.
    assert 0 < result.criteria.score - float(measures.score) < 3e-3
    assert 0 < float(measures.down) - result.criteria.swingup_time / RULES.duration < 8e-3


def test_being_away_costs_more_the_farther():
    def away(x):
        trajectory = Trajectory(RULES.dt * jnp.arange(3), jnp.tile(jnp.array(x), (3, 1)), jnp.zeros((3, 2)))
        return float(measure(trajectory, leaderboard_parameters(ACROBOT), RULES.dt, RULES).away)

    ways = [away(x) for x in ([np.pi, 0, 0, 0], [np.pi - 0.2, 0.1, 0, 0], [2.0, 1.0, 0, 0], [0.0, np.pi, 0, 0])]
    assert ways == sorted(ways)
    assert ways[0] == 0
    assert 0.9 < ways[-1] <= 1
    assert away([3 * np.pi, -2 * np.pi, 0, 0]) == pytest.approx(0, abs=1e-6)


def test_the_cost_weighs_the_measures():
    measures = Measures(score=jnp.array(0.5), down=jnp.array(0.2), away=jnp.array(0.4))
    assert float(Weights(score=1.0).cost(measures)) == -0.5
    assert float(Weights(0.5, 0.5, 0.25).cost(measures)) == pytest.approx(0.1 + 0.1 - 0.25)


def test_nominal_episodes_have_weights_of_their_own():
    episodes = draw(np.random.default_rng(0), ACROBOT, Draws(nominal=1, model=1, pushed=0, measured=0, anywhere=0))
    settings = PolicyGradientSettings(duration=0.1, nominal=Weights(score=1.0), others=Weights(down=3.0))
    cost = jax.jit(batch_cost, static_argnames="settings")
    total, measures = cost(small().policy.actor, small(), episodes, settings=settings)
    first = int(np.argmax(episodes.nominal))
    assert float(total) == pytest.approx(float(3 * measures.down[1 - first] - measures.score[first]) / 2, rel=1e-5)


def test_the_adjoint_is_cut_and_the_state_is_not():
    x = jnp.array([1.0, 2.0, 3.0, 4.0])
    assert np.array_equal(bound_adjoint(x, 0.1), x)
    gradient = jax.grad(lambda x: bound_adjoint(x, 0.5) @ jnp.array([3.0, 0.0, 4.0, 0.0]))(x)
    assert np.allclose(gradient, [0.3, 0.0, 0.4, 0.0])
    assert np.allclose(jax.grad(lambda x: bound_adjoint(x, 9.0)[0])(x), [1, 0, 0, 0])
    assert np.array_equal(jax.grad(lambda x: jnp.sqrt(bound_adjoint(x, 9.0)[0]))(0 * x), jnp.zeros(4))


def test_the_gradient_through_an_episode_is_that_of_finite_differences(x64):
    controller = jax.tree.map(lambda leaf: jnp.asarray(leaf, jnp.float64) if eqx.is_array(leaf) else leaf, small())
    episodes = draw(np.random.default_rng(3), ACROBOT, FEW)
    episodes = jax.tree.map(lambda leaf: leaf.astype(np.float64) if leaf.dtype.kind == "f" else leaf, episodes)
    settings = PolicyGradientSettings(duration=0.2, adjoint_limit=1e9)
    actor = controller.policy.actor

    @jax.jit
    def value(actor):
        return batch_cost(actor, controller, episodes, settings)[0]

    gradient = jax.jit(jax.grad(value))(actor)
    direction = jax.tree.map(
        lambda leaf: jnp.asarray(np.random.default_rng(leaf.size).normal(size=leaf.shape)), actor
    )
    along = sum(jnp.vdot(a, b) for a, b in zip(jax.tree.leaves(gradient), jax.tree.leaves(direction), strict=True))
    ahead, behind = (
        value(jax.tree.map(lambda leaf, d, s=size: leaf + s * d, actor, direction)) for size in (1e-6, -1e-6)
    )
    assert float(along) == pytest.approx(float((ahead - behind) / 2e-6), rel=1e-4)


def test_a_descent_lowers_the_cost_and_does_not_depend_on_how_it_is_split():
    draws = Draws(nominal=0, model=8, pushed=0, measured=0, anywhere=0, upright=1.0)
    episodes = draw(np.random.default_rng(0), ACROBOT, draws)
    settings = PolicyGradientSettings(iterations=16, learning_rate=3e-3, duration=0.06)
    one, two = AnalyticPolicyGradient(small(), settings), AnalyticPolicyGradient(small(), settings)
    one._parts, two._parts = 1, 2
    first = one.step(episodes)
    assert np.allclose(two.step(episodes).away, first.away, atol=1e-6)
    for leaf, other in zip(jax.tree.leaves(one.iterate), jax.tree.leaves(two.iterate), strict=True):
        assert np.allclose(leaf, other, atol=1e-5)
    for _ in range(15):
        last = one.step(episodes)
    assert np.mean(last.away) < np.mean(first.away)


def test_a_policy_learns_what_a_teacher_shows():
    settings = CloningSettings("tvlqr", steps=300, batch=256, shown=8, duration=5.0, shove=0.1)
    teacher = baseline("tvlqr", ACROBOT)
    states, torques = demonstrate(teacher, ACROBOT, settings, np.random.default_rng(0))
    assert states.shape == (len(torques), 4)
    assert len(torques) % 2500 == 0
    assert np.abs(torques).max() <= 6

    def miss(controller):
        given = jax.vmap(lambda x: controller(None, 0.0, x)[1][1])(jnp.float32(states[::50]))
        return float(np.mean((given - torques[::50]) ** 2))

    taught = imitate(small(), teacher, ACROBOT, settings, np.random.default_rng(0))
    assert miss(taught) < 0.2 * miss(small())


def test_a_teacher_that_never_ends_upright_is_refused():
    settings = CloningSettings("lqr", shown=2, duration=0.1)
    with pytest.raises(SwingupError, match="never ended upright"):
        demonstrate(baseline("lqr", ACROBOT), ACROBOT, settings, np.random.default_rng(0))


def test_a_recipe_reports_repeats_itself_and_keeps_the_observation():
    stages = (Refinement(SHORT, FEW, weak=0.5),)
    reports = []
    first = refine(small(), ACROBOT, stages, 5, reports.append, every=2)
    assert [(each.stage, each.iteration, each.of) for each in reports] == [(1, 2, 4), (1, 4, 4)]
    assert set(reports[0].measures) == {"nominal_score", "others_down"}
    again, other = refine(small(), ACROBOT, stages, 5), refine(small(), ACROBOT, stages, 6)
    weights = [each.policy.actor.mean_head.weight for each in (first, again, other)]
    assert np.array_equal(weights[0], weights[1])
    assert not np.array_equal(weights[0], weights[2])
    assert first.policy.stages == small().policy.stages
    assert first.policy.actor.std_head is None


def test_strength_grows_from_weak_to_full():
    stage = Refinement(dataclasses.replace(SHORT, iterations=100), FEW, weak=0.3)
    assert [stage.strength(step) for step in (0, 40, 80, 99)] == pytest.approx([0.3, 0.65, 1.0, 1.0])
