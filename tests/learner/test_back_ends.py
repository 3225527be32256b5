"""Back ends: the host loop has the same algorithm, cores and devices share a run's seeds."""

import json
import os
import subprocess
import sys
import types

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from areapo.test_probes import SMALL, softmax_policy, values
from swingup.areapo.config import Config
from swingup.areapo.initial import begin_episodes, init_learner
from swingup.areapo.state import LossMetrics
from swingup.learner import compiled_backend
from swingup.learner import host_backend as host
from swingup.learner.environments import make_environments
from swingup.learner.host_backend import HostBackend, collect_on_host
from swingup.tasks.task import Step

from .environments import Lever, Noisy, Stairs, chains


def learn(mode, temperature):
    """Train on a cycle, at a high learning rate, then at a low one to settle; the metrics are the last part's."""
    # Many environments and few steps: the host pays by the step.
    sizes = {"num_envs": 64, "num_steps": 8, "temperature": temperature, "gain": Config().gain}
    config = Config(**(vars(SMALL) | sizes | {"gain_step_size": 0.05}))
    fine = Config(**(vars(config) | {"learning_rate": config.learning_rate / 10, "gain_step_size": 0.01}))
    env = chains(config.num_envs, "cycle", mode)
    first, second = (HostBackend(env, "cycle", c, [0], 0) for c in (config, fine))
    state = first.begin(first.init(), 0)
    state, _ = first.train(state, 120)
    state, _ = second.train(second.begin(state, 120), 50)
    state, (metrics,) = second.train(state, 60)
    return state, metrics.as_dict()


@pytest.mark.slow
@pytest.mark.parametrize("mode", [AutoresetMode.SAME_STEP, AutoresetMode.NEXT_STEP])
def test_gain_bias_and_policy_of_a_cycle(mode):
    # As without the choice ρ = 1 and v(1) - v(0) = 1; the choice adds softmax((0, 1, 2) / τ), whose soft gain is
    # τ log(1 + e^(1/τ) + e^(2/τ)). The time limit after 9 steps shows in the reward collected, not in the gain.
    best, objective = softmax_policy([0.0, 1.0, 2.0], 0.4)
    state, row = learn(mode, 0.4)
    assert row["gain"] + row["entropy_gain"] == pytest.approx(1.0 + objective, rel=0.02)
    assert row["gain"] == pytest.approx(1.0 + best @ [0, 1, 2], rel=0.02)
    assert row["reward"] == pytest.approx(8 / 9 + best @ [0, 1, 2], rel=0.02)
    stage = state.statistics.stage()
    policies = [np.asarray(jax.nn.softmax(state.actor(stage(jnp.array([s]))).logits)) for s in (0.0, 1.0)]
    np.testing.assert_allclose(policies, [best, best], atol=0.02)
    # v(0) = r(0) - ρ + v(1) and v(1) = r(1) - ρ + v(0), so that v(1) - v(0) = (r(1) - r(0)) / 2 of this policy.
    zero, one = values(state, [0.0, 1.0])[:, 0]
    assert one - zero == pytest.approx(1.0 + (policies[1] - policies[0]) @ [0, 1, 2] / 2, rel=0.02)
    assert row["episode_length"] == 9.0
    assert row["episode_return"] == pytest.approx(9 * row["reward"], rel=0.02)


TINY = Config(num_envs=2, num_steps=16, num_epochs=1, batch_size=32, policy_layers=(8,), value_layers=(8,))


@pytest.mark.parametrize(
    ("mode", "terminates"), [(AutoresetMode.SAME_STEP, False), (AutoresetMode.NEXT_STEP, True)]
)
def test_a_rollout_holds_what_the_actor_saw_and_did(mode, terminates):
    config = Config(**(vars(SMALL) | {"num_envs": 3, "num_steps": 10, "batch_size": 30}))
    environments = make_environments(SyncVectorEnv([lambda: Stairs(terminates)] * 3, autoreset_mode=mode), 3)
    state = jax.jit(init_learner, static_argnums=1)(jax.random.key(0), environments.spaces, config)
    state = begin_episodes(state, environments.reset(0))
    after, rollout = collect_on_host(state, environments, config)
    log_prob = jax.jit(jax.vmap(jax.vmap(lambda o, z: state.actor(o).log_prob(z))))
    log_probs = log_prob(rollout.observations, rollout.latents)
    np.testing.assert_allclose(log_probs, rollout.log_probs, atol=1e-5)
    assert np.ptp(rollout.latents) > 0.1
    # Where nothing ended the next observation is the next row's.
    following = np.concatenate([rollout.observations[1:], np.asarray(after.observations)[None]])
    same = np.isclose(rollout.next_observations, following, atol=1e-6)[..., 0]
    ended, never = (rollout.terminated, rollout.truncated)[:: 1 if terminates else -1]
    assert not never.any()
    np.testing.assert_array_equal(same, ~ended)
    # Episodes of three steps, and in one mode a row for the reset.
    every = 3 if mode is AutoresetMode.SAME_STEP else 4
    np.testing.assert_array_equal(np.flatnonzero(ended[:, 0]), np.arange(2, 10, every))
    if mode is AutoresetMode.NEXT_STEP:
        np.testing.assert_array_equal(np.flatnonzero(rollout.counted[:, 0] == 0), [3, 7])
    # 11 batches of three: the reset and ten steps.
    assert after.statistics.count == pytest.approx(33.0, abs=0.01)


def test_calls_of_unequal_length_count_by_their_iterations(monkeypatch):
    """Two iterations with a loss of 1 and one of 4: (2 * 1 + 4) / 3 = 2."""
    backend = compiled_backend.CompiledBackend(Lever(), TINY, [0], None)
    losses = iter([1.0, 4.0])
    backend._advance = lambda state, *_: (state, LossMetrics(*5 * [np.float32(next(losses))]))
    state = types.SimpleNamespace(actor=np.zeros(1), critic=np.zeros(1))
    # Two weights and rollouts of 32 frames: calls of two iterations.
    monkeypatch.setattr(compiled_backend, "CALL_WORK", 2 * 2 * 32)
    _, (found,) = backend.train(state, 3)
    assert found.means.policy_loss == 2.0


def test_each_checkpoint_is_followed_by_other_starts():
    backend = HostBackend(Noisy, "noisy", TINY, [0], 0)
    state = backend.init()
    starts = [backend.begin(state, iterations).observations for iterations in (0, 4, 0)]
    np.testing.assert_array_equal(starts[0], starts[2])
    assert not np.array_equal(starts[0], starts[1])


class Lottery(Lever):
    """Pays 1 for a step whose key is another than that of the step before."""

    def reset(self, key):
        return jnp.zeros(()), jnp.zeros(2, jnp.uint32)

    def observe(self, state):
        return state[0][None]

    def step(self, state, action, key):
        steps, before = state
        now = jax.random.key_data(key)
        after = steps + 1.0, now
        return Step(after, self.observe(after), jnp.any(now != before) * 1.0, jnp.array(False), after[0] >= 10.0)


def test_each_step_of_an_evaluation_has_a_key_of_its_own():
    evaluator = compiled_backend.ReturnEvaluator(Lottery(), 0, 3, "lottery")
    assert evaluator.evaluate(jax.tree_util.Partial(lambda observation: jnp.zeros(1, int))).score == 10.0


PROGRAM = """
import json, sys
import jax
from swingup import AREAPO

sizes = {"num_envs": 2, "num_steps": 8, "num_epochs": 1, "batch_size": 16}
layers, rows = {"policy_layers": (8,), "value_layers": (8,)}, []
model = AREAPO("acrobot", seeds=int(sys.argv[1]), evaluate_every=32, **sizes, **layers)
model.learn(32, lambda _, report: rows.extend(report.rows))
state, backend = model._run.snapshot()[0], model._run.backend
# Seeds are independent: no device waits for another.
compiled = backend._advance.lower(state, backend._task, model.config, 1).compile().as_text()
exchanges = ("all-gather", "all-reduce", "all-to-all", "collective-permute", "reduce-scatter")
assert not [name for name in exchanges if name in compiled]
used = len(state.actor.mean_head.weight.sharding.device_set)
print(json.dumps([len(jax.devices()), used, [row.gain for row in rows[-model.settings.seeds:]]]))
"""


def trained(devices, seeds=4):
    """How many devices there are and are used, and the seeds' gains."""
    flags = f"{os.environ.get('XLA_FLAGS', '')} --xla_force_host_platform_device_count={devices}"
    command = [sys.executable, "-c", PROGRAM, str(seeds)]
    result = subprocess.run(command, env=os.environ | {"XLA_FLAGS": flags}, capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
    return json.loads(result.stdout)


@pytest.mark.slow
def test_two_devices_share_four_seeds_and_not_three():
    (there, used, gains), (_, alone, expected) = trained(2), trained(1)
    assert (there, used, alone) == (2, 2, 1)
    assert len(set(gains)) == 4
    # The same seeds, to rounding: each device has a batch of half the size.
    assert gains == pytest.approx(expected, rel=1e-3, abs=1e-5)
    assert trained(2, seeds=3)[:2] == [2, 1]


@pytest.mark.slow
def test_a_program_trains_on_the_cores_that_it_asked_for():
    """As many as share the seeds evenly, unless the user has said how many."""
    theirs = "--xla_force_host_platform_device_count=3"
    for seeds, there, flags, expected in ((4, 2, "", 2), (6, 8, "", 6), (3, 2, "", 1), (4, 2, theirs, 3)):
        program = "from swingup.learner import compiled_backend as backend\n"
        program += f"backend.cores = lambda: {there}\nbackend.share_cores({seeds})\n"
        program += "import jax; print(jax.device_count())"
        environment = os.environ | {"XLA_FLAGS": flags, "JAX_PLATFORMS": "cpu"}
        shown = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True)
        assert shown.stdout.strip() == str(expected), shown.stderr


def test_nothing_is_compiled_twice():
    # Episodes of three steps: rows with and without an end both come in the first rollout.
    backend = HostBackend(Stairs, "stairs", TINY, [0], 0)
    state, _ = backend.train(backend.begin(backend.init(), 0), 1)
    compiled = (host._sample, host._noise, host._advance, host._update)
    before = [function._cache_size() for function in compiled]
    state, _ = backend.train(state, 2)
    backend.train(backend.begin(state, 3), 1)
    assert [function._cache_size() for function in compiled] == before


def test_after_the_first_computation_nothing_changes():
    before = jax.device_count()
    compiled_backend.share_cores(64)
    assert jax.device_count() == before
    assert jax.config.values["jax_cpu_enable_async_dispatch"]
