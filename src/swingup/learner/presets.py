"""Named settings of task and algorithm; presets are Python values."""

from dataclasses import dataclass
from typing import Any

from ..areapo.config import Config
from ..common.checks import one_of

PENDULUM, DM_ACROBOT, ENVIRONMENT = "pendulums", "dm_control's acrobot", "environments"
"""Kinds of tasks."""


@dataclass(frozen=True)
class Preset:
    """A task variant and the algorithm's hyperparameters."""

    summary: str
    """A description in one line."""
    config: Config
    """The algorithm."""
    frames: int = 12_000_000
    """Default length of a run."""
    task: str = "smooth"
    """The pendulum's variant, a name of :data:`swingup.tasks.presets.TASKS`."""
    seeds: int = 1
    """Default number of seeds side by side; a command keeps the best policy of all."""
    only: str | None = None
    """The only kind of task that it is for; None for any."""


_ENVIRONMENT: dict[str, Any] = {
    # Minibatches that divide the rollout of a single environment, too.
    "num_envs": 8, "num_steps": 250, "num_epochs": 10, "batch_size": 50, "policy_layers": (64, 64),
    "value_layers": (64, 64), "activation": "tanh", "normalise_rewards": True, "temperature": 0.002,
    # Noise of 1 for a swimmer, of 0.15 for an ant.
    "log_std_init": 0.0, "deviation": "fitted",
    "clip_range": 0.2, "learning_rate": 3e-4, "max_grad_norm": 0.5, "value_coefficient": (0.5, 0.25),
}  # fmt: skip
"""What both presets of environments have."""

PRESETS = {
    "pendulum": Preset(
        "Table I on the task without its edges (sines and cosines), with the values' free constant fixed, and "
        "smaller steps in the second half",
        Config(centre_values=True, gain="td", schedule="anneal", schedule_frames=12_000_000),
        only=PENDULUM,
    ),
    # 50 million as in the authors' configuration; the published policies were saved at 46.7 and 48.2 million.
    "paper": Preset(
        "Table I of the paper, with the gains of its authors' code, on the paper's task",
        Config(), 50_000_000, "paper", only=PENDULUM,
    ),
    "global": Preset(
        "recovery from throws: reward for time up, networks of half the width, less entropy",
        # The pendubot was up for 0.69 of the time after 3 million frames at τ = 2, for 0.73 after 2 at τ = 0.4.
        Config(
            centre_values=True, gain="td", temperature=0.4, policy_layers=(128, 128), value_layers=(256, 256),
        ),
        6_000_000,
        "global",
        only=PENDULUM,
    ),
    "small": Preset(
        "networks of 64-64 for any plant: quadratic cost, starts anywhere, short rollouts, little entropy",
        Config(
            centre_values=True, gain="td", num_envs=32, num_steps=64, batch_size=256, policy_layers=(64, 64),
            value_layers=(64, 64), temperature=0.1, gae_lambda=(0.95, 0.9), clip_range=0.1, learning_rate=1e-3,
        ),
        6_000_000,
        "anywhere",
        only=PENDULUM,
    ),
    "fast": Preset(
        "the paper's score in about half a minute: networks of 64-64, short episodes, warm restarts, two seeds",
        Config(
            centre_values=True, gain="td", num_epochs=3, batch_size=512, policy_layers=(64, 64),
            value_layers=(64, 64), temperature=1.4, gae_lambda=(0.95, 0.9), clip_range=0.2, learning_rate=1.2e-3,
            # Each cycle ends in another policy, and the best is kept.
            schedule="anneal_entropy", schedule_frames=6_000_000,
        ),
        24_000_000,
        "short",
        seeds=2,
        only=PENDULUM,
    ),
    "dm-acrobot": Preset(
        "dm_control's acrobot, from starts of its own, in actions of 20 ms: large rollouts, discounted rewards",
        Config(
            num_envs=2048, num_epochs=4, batch_size=8192, policy_layers=(128, 128), value_layers=(128, 128),
            # Standing and falling are two closed classes of states, whose values would part without bound.
            temperature=0.015, gain="none", discount=(0.996, 0.996), gae_lambda=(0.97, 0.9), clip_range=0.2,
            learning_rate=1.2e-3, schedule="anneal", schedule_frames=100_000_000,
        ),
        100_000_000,
        only=DM_ACROBOT,
    ),
    "ppo": Preset(
        "discounted rewards, no entropy (PPO, arXiv 1707.06347), with the sizes that Stable-Baselines3 gives it",
        Config(
            num_envs=1, num_steps=2048, num_epochs=10, batch_size=64, policy_layers=(64, 64), value_layers=(64, 64),
            # At τ = 0 nothing reads the entropy's values, but discounted values are refused at 1.
            gain="none", terminations="end", temperature=0.0, discount=(0.99, 0.99), gae_lambda=(0.95, 0.95),
            clip_range=0.2, learning_rate=3e-4, max_grad_norm=0.5, value_coefficient=(0.5, 0.0), log_std_init=0.0,
            activation="tanh", deviation="action", normalise_rewards=True,
        ),
        1_000_000,
    ),
    "episodes": Preset(
        "discounted rewards with entropy (EAPO, arXiv 2407.18143) for tasks with episodes",
        Config(
            **_ENVIRONMENT, gain="none", discount=(0.99, 0.99), gae_lambda=(0.95, 0.9), terminations="end",
        ),
        1_000_000,
    ),
    "continuing": Preset(
        "average reward with entropy (AR-EAPO) for tasks that go on",
        Config(
            **_ENVIRONMENT, gain="td", centre_values=True,
            # λ = 0.98 sees a swimmer's slow rewards before the critic does.
            gae_lambda=(0.98, 0.95), schedule="anneal_lambda", schedule_frames=150_000,
            # A step that suits the swimmer moves the ant too far.
            target_kl=0.02, terminations="adaptive_cost", reset_cost=100.0,
            # Without it the means of some swimmers reach ±7 and σ 2.5, and they never learn to swim.
            excess_coefficient=0.003,
        ),
        1_000_000,
    ),
}  # fmt: skip

PENDULUM_PRESET = "pendulum"
"""The default of the robots."""
ACROBOT_PRESET = "dm-acrobot"
"""The default of dm_control's acrobot."""
CONTINUING_PRESET = "continuing"
"""The default of continuing tasks and of streams."""
ENV_PRESET = "episodes"
"""The default of every other task."""


def get_preset(name: str) -> Preset:
    """Look a preset up by its name."""
    return PRESETS[one_of("preset", name, PRESETS)]
