"""Distillation: the plants, the teachers, the dataset and the student."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from policies import lone_policy, new_actor
from swingup.benchmark.boards import ROBUSTNESS
from swingup.benchmark.robustness_board import MODEL_SWEEPS, make_cases
from swingup.controllers.baselines.continuation import ContinuationSettings, nominal_swingups
from swingup.controllers.stack.policy import Policy, PolicyController, policy_alone
from swingup.controllers.stack.regulator import TRIANGLE
from swingup.dynamics.dynamics import UPRIGHT, acceleration, gravity_torque
from swingup.loop.resolve import resolve
from swingup.loop.starts import PASSING, STILL, Starts, still_states
from swingup.plant.base_parameters import base_parameters
from swingup.plant.files import load_plant
from swingup.plant.plant import LEADERBOARD, NAMES, get_robot, validated
from swingup.plant.units import C1, arm_scales, similar_plant
from swingup.policy.regulator import RegulatorSettings, fixed_point
from swingup.policy.shipped import load_policy
from swingup.refine import teachers as teaching
from swingup.refine.distil import (
    Recoveries,
    distil,
    make_recoveries,
    make_regulators,
    new_student,
    plant_scale,
    recover,
    recovery_cost,
)
from swingup.refine.gradient import EpisodeWeights, single_precision
from swingup.refine.recipe import RECIPES, RECOVER_ON_MANY, wrapped_policy
from swingup.refine.rollouts import own_runs
from swingup.refine.teachers import (
    ROW_STRIDE,
    TOP_COST,
    PlantDraws,
    TrainingSet,
    draw_plants,
    make_teachers,
    make_training_set,
    matched_torque,
    plants_of,
    top_cost,
)
from swingup.tasks.task import PendulumStage

ACROBOT, PENDUBOT = get_robot("acrobot"), get_robot("pendubot")
SCORED = RECIPES["adapt"][1].scored
FEW = dataclasses.replace(
    RECIPES["adapt"][1], draws=PlantDraws(1, 1, 1, 1), copies=16, rounds=2, steps=400,
    scored=dataclasses.replace(SCORED, steps=4, recoveries=2, duration=0.1),
)  # fmt: skip
RECORDED = resolve(domain="recorded")


teacher_torque = eqx.filter_jit(teaching.teacher_torque)


def changes(plant, robot):
    nominal = LEADERBOARD.driven(robot)
    return {name for name in NAMES if getattr(plant, name) != getattr(nominal, name)}


def small(robot=ACROBOT):
    """A policy that gives strong torques at once; it recovers from nothing."""
    actor = new_actor(6, (8, 8))
    return single_precision(PolicyController(Policy((PendulumStage(angles="sincos"),), actor), 6.0, robot))


def a_teacher(robot):
    teachers = make_teachers(nominal_swingups(robot, 1, ContinuationSettings()))
    return teachers, jax.tree.map(lambda leaf: leaf[0], teachers)


def drawn(robot, *numbers, seed=0, nominal=LEADERBOARD, domain=RECORDED):
    return plants_of(draw_plants(np.random.default_rng(seed), robot, PlantDraws(*numbers), nominal, domain))


def test_plants_are_drawn_about_the_leaderboards(robot):
    plants = drawn(robot, 40, 10, 20, 30)
    assert len(plants) == 100
    passive = {"acrobot": "1", "pendubot": "2"}[robot.name]
    assert all(len(changes(plant, robot)) == 1 for plant in plants[:40])
    assert len(set.union(*(changes(plant, robot) for plant in plants[:40]))) == len(MODEL_SWEEPS)
    assert all(len(changes(plant, robot)) == 10 for plant in plants[40:50])
    assert all(getattr(plant, f"cf{passive}") > 0 for index, plant in enumerate(plants[50:70]) if index % 3 < 2)
    assert all(getattr(plant, f"b{passive}") > 0 for plant in plants[52:70:3])
    assert [len(changes(plant, robot)) for plant in plants[50:52]] == [10, 1]
    half = [abs(plant.I1 / LEADERBOARD.driven(robot).I1 - 1) for plant in plants[40:50]]
    assert 0 < max(half) <= 0.125


def test_the_robots_plants_are_as_heavy_as_its_motor_is_weak_and_one_of_four_has_a_rotor_of_any_inertia(robot):
    plants = drawn(robot, 0, 0, 0, 80)
    nominal, heavier = LEADERBOARD.driven(robot), np.array([plant.m2 for plant in plants])
    # The domain ``recorded`` has gains from 0.75 to 1, r2 from 0.2429 to 0.2685 m, I2 from 0.0449 to 0.0535 kg m².
    # Each range has a tenth more at both ends.
    gains = nominal.m2 / heavier
    assert 0.725 <= gains.min() < 0.8 < 0.95 < gains.max() <= 1.025
    assert all(0.2403 <= plant.r2 <= 0.2711 for plant in plants)
    assert all(0.0440 < gain * plant.I2 < 0.0544 for gain, plant in zip(gains, plants, strict=True))
    # What the compensation leaves, or up to half of that too much.
    left = np.array([[plant.cf1, plant.cf2, 10 * plant.b1, 10 * plant.b2] for plant in plants])
    assert -0.02 <= left.min() < 0 < 0.03 < left.max() <= 0.04
    others = [plant for index, plant in enumerate(plants, start=1) if index % 4]
    # The domain has 6e-5 to 1.5e-4 kg m², a tenth of that more at the ends, by gains from 0.725 on.
    assert max(plant.Ir for plant in others) < 1.59e-4 / 0.725
    assert max(plant.Ir for plant in others) < max(plant.Ir for plant in plants[3::4]) <= 3e-4
    # A rotor takes its inertia from the upper link: together they stay in the domain, from 0.0213 kg m² on.
    least = 0.0213 - 0.1 * (0.0335 - 0.0213) + 36 * (6e-5 - 0.1 * (1.5e-4 - 6e-5))
    assert min(plant.I1 + 36 * plant.Ir for plant in plants) > least
    assert min(plant.I1 for plant in plants[3::4]) < min(plant.I1 for plant in others)


def test_recoveries_begin_after_throws_about_the_top_and_hanging():
    teachers, _ = a_teacher(PENDUBOT)
    starts = Starts(0.25, thrown_on_robot=0.25, near_top=0.25, passing=0.125, hanging=0.125, spread=0.02)
    scored = dataclasses.replace(SCORED, starts=starts, nominal=0.5)
    of, cost_to_go = (teachers.plant, teachers.base), teachers.cost_to_go[-1]
    found = make_recoveries(small(PENDUBOT), *of, cost_to_go, scored, np.random.default_rng(0))
    starts = np.asarray(found.starts)
    errors = starts - np.array([np.pi, 0, 0, 0])
    costs = np.einsum("ni,ij,nj->n", errors, np.asarray(cost_to_go), errors)
    assert (len(costs), (costs[:4096] < 1).mean() < 0.05) == (8192, True)
    assert np.sort(costs[4096:6144]) == pytest.approx(np.linspace(0, 1, 2048), abs=0.06)
    assert np.abs(errors[6144:7168]).mean(axis=0) == pytest.approx(np.sqrt(2 / np.pi) * np.array(PASSING), rel=0.15)
    assert np.abs(np.sin(starts[7168:] / 2)).max() < 0.05
    # A second of a weak throw is slower at its end than a fifth of one of a strong one.
    assert np.abs(starts[2048:4096, 2:]).mean() < 0.5 * np.abs(starts[:2048, 2:]).mean()
    assert ((starts[:, 0] >= 0) & (np.abs(starts[:, :2] - [np.pi, 0]) <= np.pi + 1e-5).all(1))[:7168].all()
    assert np.asarray(found.on).tolist() == [teachers.number - 1] * 1024 + [-1] * 7168


@pytest.mark.slow
def test_recoveries_have_their_plants_regulators_at_the_top_and_the_policy_below(either_robot):
    student, joint = small(either_robot), either_robot.joint
    draws = np.random.default_rng(2), either_robot, PlantDraws(0, 3, 0, 0)
    plants = draw_plants(*draws, LEADERBOARD, RECORDED)
    held = [fixed_point(plant, joint) for plant in plants_of(plants)]
    regulators = make_regulators(student, np.stack([P[TRIANGLE] for P, _ in held]), RegulatorSettings())
    bases = jnp.float32(np.stack([base_parameters(plant) for plant in plants_of(plants)]))
    error = np.array([0.004, -0.002, 0.0, 0.0])
    starts = jnp.float32(UPRIGHT + error)[None]
    cases = Recoveries(single_precision(plants), bases, starts, jnp.array([-1]), regulators)
    torques = []
    for index, (_, gains) in enumerate(held):
        informed = cases.informed(student, index)
        torques.append(float(informed(informed.init(), jnp.zeros(()), starts[0])[1][joint]))
        assert torques[-1] == pytest.approx(-gains[:4] @ error, rel=1e-3)
        below = informed(informed.init(), jnp.zeros(()), jnp.zeros(4))[1]
        assert np.array_equal(below, student(None, jnp.zeros(()), jnp.zeros(4))[1])
    assert np.ptp(torques) > 0.05 * np.abs(torques).max()
    short = dataclasses.replace(SCORED, recoveries=6, duration=0.8)
    with_them, without = (
        recovery_cost(student, each, short, jax.random.key(0)) for each in (cases, cases._replace(regulators=None))
    )
    assert with_them < 0.1 * without


@pytest.mark.slow
def test_a_policy_that_sees_its_plant_recovers_better_and_keeps_its_torques():
    random = np.random.default_rng(0)
    plants = draw_plants(random, ACROBOT, PlantDraws(1, 1, 1, 1), LEADERBOARD, RECORDED)
    shipped = single_precision(policy_alone(load_policy("adaptive", ACROBOT)))
    before = eqx.tree_at(lambda c: c.policy.actor.std_head, shipped, None, is_leaf=lambda leaf: leaf is None)
    weights, starts = EpisodeWeights(down=3.0, away=2.0, fast=30.0), Starts(passing=1.0)
    few = {"steps": 24, "weight": 0.0, "recoveries": 8, "duration": 0.3, "batch": (0, 64)}
    scored = dataclasses.replace(RECOVER_ON_MANY[0].scored, **few, starts=starts, weights=weights)
    stage, kept = dataclasses.replace(RECOVER_ON_MANY[0], scored=scored), []
    after = recover(before, plants, stage, random, RegulatorSettings(), lambda now, done: kept.append(done))
    assert kept == [0, 0, 0, 1]
    bases = jnp.float32(np.stack([base_parameters(plant) for plant in plants_of(plants)]))
    many = dataclasses.replace(scored, recoveries=256)
    cases = make_recoveries(before, single_precision(plants), bases, np.eye(4), many, np.random.default_rng(1))
    cost = eqx.filter_jit(lambda policy: recovery_cost(single_precision(policy), cases, many, jax.random.key(0)))
    assert cost(after) < cost(before) - 0.01
    x = jnp.zeros(4)
    hanging = [float(each.control(None, 0.0, x, bases[0])[1][1]) for each in (before, after)]
    assert hanging[1] == pytest.approx(hanging[0], abs=1.0)
    assert len(after.policy.actor.trunk) == 3
    # Of a policy without a good run nothing is kept, and nothing fails.
    spoilt = jax.tree.map(lambda leaf: leaf * np.nan, before.policy.actor)
    wild = eqx.tree_at(lambda c: c.policy.actor, before, spoilt)
    found = own_runs(wild, single_precision(plants), bases, random, 3)
    assert (found.x.shape, found.weight.tolist()) == ((1, 4), [0.0])


def test_no_plant_is_on_the_grid_that_judges():
    plants = {tuple(map(float, jax.tree.leaves(plant))) for plant in drawn(ACROBOT, 50, 5, 20, 5, seed=1)}
    cases = make_cases(ACROBOT, ROBUSTNESS, "model", 0)
    assert not plants & {tuple(map(float, jax.tree.leaves(case.scenario.parameters))) for case in cases}


@pytest.mark.slow
def test_the_swingup_teaches_near_it_the_regulator_at_the_top_and_the_recovering_policy_elsewhere(either_robot):
    teachers, teacher = a_teacher(either_robot)
    assert teachers.number == 1
    recovery, row = small(either_robot), 60
    torque, distance = teacher_torque(teacher, recovery, teacher.states[row])
    assert (float(torque), float(distance)) == (float(teacher.torque[row]), 0.0)
    # A whole turn is no distance, and the gains answer a small error.
    error = jnp.array([2 * jnp.pi + 0.002, -0.001, 0.0, 0.01], jnp.float32)
    torque, distance = teacher_torque(teacher, recovery, teacher.states[row] + error)
    off = np.array([0.002, -0.001, 0.0, 0.01])
    assert float(torque) == pytest.approx(float(teacher.torque[row] + teacher.gains[row] @ off), abs=2e-3)
    assert 0 < float(distance) < 0.003
    error = np.array([0.001, 0.002, 0.0, 0.0], np.float32)
    assert error @ teacher.cost_to_go @ error < TOP_COST
    torque, _ = teacher_torque(teacher, recovery, jnp.float32([np.pi, 0, 0, 0]) + error)
    assert float(torque) == pytest.approx(float(-teacher.top_gains[:4] @ error), abs=1e-4)
    # Dry friction of the undriven joint is answered there, and makes that region smaller.
    friction = jnp.float32(0.02), jnp.float32(0.7 * 0.02)
    with_friction = eqx.tree_at(lambda one: (one.coulomb, one.dry_torque), teacher, friction)
    error = np.zeros(4, np.float32)
    error[3 - either_robot.joint] = 0.1
    more = teacher_torque(with_friction, recovery, jnp.float32([np.pi, 0, 0, 0]) + error)[0]
    less = teacher_torque(teacher, recovery, jnp.float32([np.pi, 0, 0, 0]) + error)[0]
    assert float(more - less) == pytest.approx(0.7 * 0.02 * np.arctan(1.0) * float(teacher.top_gains[4]), abs=1e-4)
    at = jnp.float32([np.pi, 0.004, 0, 0])
    at += (at - jnp.float32(UPRIGHT)) * (np.sqrt(0.6 * TOP_COST / top_cost(teacher, at)) - 1)
    expected = pytest.approx(float(-teacher.top_gains[:4] @ (at - jnp.float32(UPRIGHT))), abs=1e-3)
    torques = [
        teacher_torque(eqx.tree_at(lambda one: one.coulomb, teacher, dry), recovery, at)[0] for dry in (0.0, 0.1)
    ]
    assert [float(torque) == expected for torque in torques] == [True, False]
    # Rows at rest at the top do not teach.
    assert np.asarray(teacher.excluded).nonzero()[0].min() * ROW_STRIDE * 0.002 > 1.0
    x = jnp.array([1.5, 2.5, 20.0, -20.0])
    torque, distance = teacher_torque(teacher, recovery, x)
    assert distance > 1.0
    wanted = recovery(None, jnp.zeros(()), x)[1][either_robot.joint]
    assert float(torque) == pytest.approx(float(wanted), abs=1e-4)


def test_a_matched_torque_moves_another_plant_as_nearly_as_it_can_as_the_nominal_one():
    nominal = LEADERBOARD.driven(ACROBOT)
    plant = dataclasses.replace(nominal, m2=1.2 * nominal.m2, b1=0.05)
    policy, x = small(), jnp.array([1.0, 0.5, 2.0, -1.0])
    u = policy(None, jnp.zeros(()), x)[1]
    assert float(matched_torque(policy, nominal, x)) == pytest.approx(float(u[1]), abs=1e-4)
    matched = matched_torque(policy, plant, x)
    miss = [
        float(jnp.sum((acceleration(plant, x, jnp.array([0.0, matched + off])) - acceleration(nominal, x, u)) ** 2))
        for off in (-0.01, 0.0, 0.01)
    ]
    assert miss[1] < min(miss[0], miss[2])


def test_a_new_student_sees_the_plant_in_units_of_its_ranges():
    student = new_student(TrainingSet(a_teacher(ACROBOT)[0], small()), np.random.default_rng(0))
    assert student.policy.sees_plant
    nominal = LEADERBOARD.driven(ACROBOT)
    for sweep in MODEL_SWEEPS.values():
        value = sweep.sweep.high * (getattr(nominal, sweep.parameter) if sweep.relative else 1.0)
        moved = base_parameters(dataclasses.replace(nominal, **{sweep.parameter: value}))
        assert 0.1 < np.abs((moved - base_parameters(nominal)) / plant_scale(base_parameters(nominal))).max() < 3.0
    assert wrapped_policy(small()).parts == ("estimator",)
    assert wrapped_policy(student).parts == ("estimator", "identifier", "regulator")


def test_a_constant_torque_holds_the_plants_where_runs_begin_at_rest(robot):
    plants = draw_plants(np.random.default_rng(0), robot, PlantDraws(3, 3, 3, 3), LEADERBOARD, RECORDED)
    assert plants_of(similar_plant(plants, C1)) == plants_of(plants)  # a zero of the encoders each
    base = np.stack([base_parameters(plant) for plant in plants_of(plants)])
    states = still_states(np.random.default_rng(0), base, robot, 50)
    assert 0.6 < np.abs(states[..., 0]).max() < STILL
    assert not states[..., 2:].any()
    gravity = jax.vmap(jax.vmap(gravity_torque, (None, 0)))(jax.tree.map(jnp.asarray, plants), jnp.asarray(states))
    # Far from hanging, the acrobot's lower link cannot balance some plants.
    within = np.abs(np.sin(states[..., 0]) * (base[:, 3] / base[:, 2])[:, None]) < 1
    assert within.mean() > 0.7
    np.testing.assert_allclose(gravity[..., 1 - robot.joint][within], 0.0, atol=1e-6)


@pytest.mark.slow
def test_a_student_learns_and_sees_its_plant():
    recovery, rounds = lone_policy("global", "acrobot")[0], []
    targets = draw_plants(np.random.default_rng(0), ACROBOT, FEW.draws, LEADERBOARD, RECORDED)
    training = make_training_set(recovery, targets, FEW.copies)
    student = distil(training, FEW, np.random.default_rng(1), lambda now, number: rounds.append((now, number)))
    assert [number for _, number in rounds] == [1, 2, 3]
    assert student.policy.sees_plant
    _, teacher = a_teacher(ACROBOT)
    # The rows that teach: at the top the LQR does.
    rows = np.asarray(teacher.excluded) == 0
    states, wanted = jnp.float32(teacher.states[rows]), np.asarray(teacher.torque[rows])
    x = jax.vmap(lambda x: student(None, jnp.zeros(()), x)[1][1])(states)
    untrained = new_student(training, np.random.default_rng(1))
    before = jax.vmap(lambda x: untrained(None, jnp.zeros(()), x)[1][1])(states)
    assert np.abs(x - wanted).mean() < 0.6 * np.abs(before - wanted).mean()
    again = distil(training, FEW, np.random.default_rng(1))
    assert all(map(np.array_equal, jax.tree.leaves(student.policy), jax.tree.leaves(again.policy)))
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(student.policy))


def test_plants_of_any_domain_are_drawn_in_c1s_units_with_the_friction_that_no_motor_compensates(robot):
    cell = load_plant("cloudpendulum")
    domain, design = resolve(cell, share=0.1), cell.frictionless().driven(robot)
    nominal = similar_plant(design, arm_scales(design))
    plants = drawn(robot, 0, 0, 0, 40, nominal=nominal, domain=domain)
    assert all(plant.limit(robot.joint) == pytest.approx(6.0) for plant in plants)
    # 10 % either way, and a tenth of that range beyond.
    assert all(0.87 < plant.m2 / nominal.m2 < 1.13 for plant in plants)
    passive, torque = f"cf{2 - robot.joint}", arm_scales(design).torque
    most = 1.5 * getattr(cell, passive) / torque
    friction = [getattr(plant, passive) for plant in plants]
    assert 0.7 * most < max(friction) <= most
    assert min(friction) >= 0
    # With a motor there is what the compensation leaves: a quarter, as of the recorded robot.
    braked = resolve(domain, "recorded")
    plants = drawn(robot, 0, 0, 0, 40, nominal=nominal, domain=braked)
    left = max(0.04, 0.24 * most)
    assert 0.7 * left < max(getattr(plant, passive) for plant in plants) <= left


def test_every_drawn_plant_is_a_pendulum(robot):
    # One in fifty joint draws about B.0 is none: its mass matrix is nearly singular.
    domain, design = resolve("B.0", share=0.1), load_plant("B.0").frictionless().driven(robot)
    nominal = similar_plant(design, arm_scales(design))
    for plant in drawn(robot, 0, 300, 0, 0, nominal=nominal, domain=domain):
        validated(plant)
