import dataclasses
import json

import jax
import jax.numpy as jnp
import pytest

from swingup.areapo import train
from swingup.areapo.config import Config, config_from_dict
from swingup.areapo.reset_cost import adapt_reset_cost, reset_cost
from swingup.areapo.state import Rollout
from swingup.common.errors import SwingupError

from .probes import Trap

CONFIG = Config(
    num_envs=2, num_steps=4, batch_size=8, num_epochs=1, policy_layers=(8,), value_layers=(8,),
    adaptive_reset_cost=True, termination_target=0.1, reset_cost_step=0.2, reset_cost=3.0,
)  # fmt: skip


def rollout(terminated, counted=None):
    nothing = jnp.zeros((4, 2))
    return Rollout(nothing, nothing, nothing, nothing, nothing, jnp.array(terminated) > 0, nothing > 0, counted)


@pytest.mark.parametrize(
    ("cost", "ended", "expected"),
    [
        (3.0, 1, 3.0 + 0.2 * (0.125 / 0.1 - 1)),
        (3.0, 2, 3.2),  # never by more than the step, whatever the excess
        (3.0, 0, 2.8),
        (0.1, 0, 0.0),  # never below zero
    ],
)
def test_the_cost_follows_the_rate_of_a_rollout(cost, ended, expected):
    terminated = (jnp.arange(8) < ended).reshape(4, 2)
    found = adapt_reset_cost(jnp.array(cost), rollout(terminated), CONFIG)
    assert float(found) == pytest.approx(expected, rel=1e-5)


def test_rows_that_do_not_count_are_no_steps():
    counted = jnp.ones((4, 2)).at[3].set(0.0)
    found = adapt_reset_cost(jnp.array(3.0), rollout((jnp.arange(8) < 1).reshape(4, 2), counted), CONFIG)
    assert float(found) == pytest.approx(3.0 + 0.2 * (1 / 6 / 0.1 - 1), rel=1e-5)


@pytest.mark.parametrize(
    ("changes", "rewards", "expected"),
    [
        ({}, 0.5, 3.0),
        ({"relative_reset_cost": True}, 0.5, 1.5),
        ({"relative_reset_cost": True}, -0.5, 0.0),
        ({"terminations": "bootstrap"}, 0.5, 0.0),
    ],
)
def test_what_a_reset_costs(changes, rewards, expected):
    config = dataclasses.replace(CONFIG, adaptive_reset_cost=False, **changes)
    state = train.init(jax.random.key(0), Trap(), config)
    one = dataclasses.replace(rollout(jnp.zeros((4, 2))), rewards=jnp.full((4, 2), rewards))
    assert float(reset_cost(state, one, config)) == pytest.approx(expected)


def test_a_fixed_cost_stays():
    assert adapt_reset_cost(None, rollout(jnp.zeros((4, 2))), CONFIG) is None


@pytest.mark.slow  # compiles for seconds
def test_the_cost_of_a_run_is_in_its_state_and_in_its_rewards():
    state = train.init(jax.random.key(0), Trap(), CONFIG)
    assert float(state.reset_cost) == 3.0
    after, _ = jax.jit(train.iteration)(state, Trap(), CONFIG)
    assert float(after.reset_cost) > 3.0  # half of the first actions end the task
    fixed = dataclasses.replace(CONFIG, adaptive_reset_cost=False)
    same, _ = jax.jit(train.iteration)(train.init(jax.random.key(0), Trap(), fixed), Trap(), fixed)
    assert same.reset_cost is None
    # The first rollout has the same cost; the next one has another.
    assert jax.tree.all(jax.tree.map(jnp.array_equal, same.actor, after.actor))


DISCOUNTED = {"average_reward": False, "discount": 0.9, "entropy_discount": 0.9}


@pytest.mark.parametrize(
    ("changes", "adapts"),
    [
        ({}, True),
        ({"terminations": "reset_cost"}, True),
        ({"terminations": "bootstrap"}, False),
        (DISCOUNTED, False),
        (DISCOUNTED | {"terminations": "end"}, False),
        (DISCOUNTED | {"terminations": "reset_cost"}, True),
    ],
)
def test_auto_adapts_where_a_termination_costs_something(changes, adapts):
    auto = dataclasses.replace(CONFIG, adaptive_reset_cost="auto", **changes)
    assert auto.adapts_reset_cost == adapts
    state = jax.eval_shape(lambda key: train.init(key, Trap(), auto), jax.random.key(0))
    assert (state.reset_cost is not None) == adapts


def test_auto_is_the_same_program_as_on():
    """Where it adapts; where it does not, the same as off."""

    def program(**changes):
        config = dataclasses.replace(CONFIG, **changes)
        state = jax.eval_shape(lambda key: train.init(key, Trap(), config), jax.random.key(0))
        return str(jax.make_jaxpr(lambda state: train.iteration(state, Trap(), config))(state))

    assert program(adaptive_reset_cost="auto") == program()
    assert program(adaptive_reset_cost="auto", terminations="bootstrap") == program(
        adaptive_reset_cost=False, terminations="bootstrap"
    )
    assert program(adaptive_reset_cost=False) != program()


@pytest.mark.parametrize("stored", [True, False, "auto", None])
def test_files_of_every_version_load(stored):
    """None: of a version that had no such setting, when the cost was fixed."""
    values = json.loads(json.dumps(dataclasses.asdict(CONFIG)))
    values |= {"adaptive_reset_cost": stored}
    if stored is None:
        del values["adaptive_reset_cost"]
    assert config_from_dict(values) == dataclasses.replace(CONFIG, adaptive_reset_cost=stored or False)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"terminations": "bootstrap"},
            "no effect with terminations = 'bootstrap': use terminations = 'reset_cost'",
        ),
        (DISCOUNTED, "'auto' and without average_reward"),
        ({"adaptive_reset_cost": "on"}, "adaptive_reset_cost = 'on': use True, False or auto"),
        ({"adaptive_reset_cost": 1}, "adaptive_reset_cost = 1: use True, False or auto"),
        ({"termination_target": 0.0}, "termination_target"),
        ({"reset_cost_step": -1.0}, "reset_cost_step"),
    ],
)
def test_what_cannot_work_is_refused(changes, message):
    with pytest.raises(SwingupError, match=message):
        dataclasses.replace(CONFIG, **changes)
