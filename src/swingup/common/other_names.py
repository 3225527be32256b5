"""Names that Stable-Baselines3, CleanRL and rejax give to settings, and ours.

A name is not taken for ours, since most of them mean something slightly different: an error says what to write.
"""

from collections.abc import Callable

Ours = tuple[str, ...]

NETWORKS = "widths of hidden layers, such as 64 and 64"
STEPS = "steps of each environment in a rollout"
MINIBATCH = "frames, num_envs * num_steps divided by the number of minibatches"
BONUS = "it weighs a reward for entropy that has its own values, not a bonus in the loss"
UNCLIPPED = "values are not clipped: leave it out"
EXPLORATION = "exploration does not depend on the state: leave it out"
STORAGE = "a rollout's storage is fixed: leave it out"
WHEN = "frames of all environments together"

OTHER_NAMES: dict[str, tuple[Ours, str]] = {
    "n_envs": (("num_envs",), ""),
    "n_steps": (("num_steps",), STEPS),
    "rollout_length": (("num_steps",), STEPS),
    "n_epochs": (("num_epochs",), ""),
    "update_epochs": (("num_epochs",), ""),
    "num_minibatches": (("batch_size",), MINIBATCH),
    "n_minibatches": (("batch_size",), MINIBATCH),
    "minibatch_size": (("batch_size",), "frames"),
    "lr": (("learning_rate",), ""),
    "anneal_lr": (("learning_rate_schedule", "schedule_frames"), "factors (0, 1, 1, 0) fall from 1 to 0"),
    "gamma": (("discount",), "1 with average reward; below 1 in the presets ppo and eapo"),
    "lam": (("gae_lambda",), ""),
    "ent_coef": (("temperature",), BONUS),
    "entropy_coef": (("temperature",), BONUS),
    "vf_coef": (("value_coefficient",), "half of CleanRL's or rejax's, whose loss has a factor 1/2"),
    "clip_coef": (("clip_range",), ""),
    "clip_eps": (("clip_range",), ""),
    "clip_range_vf": ((), UNCLIPPED),
    "clip_vloss": ((), UNCLIPPED),
    "norm_adv": (("normalise_advantages",), ""),
    "normalize_advantage": (("normalise_advantages",), ""),
    "normalize_observations": ((), "observations are always normalised: leave it out"),
    "normalize_rewards": (("normalise_rewards",), "it divides by the deviation of a step's reward, not of returns"),
    "norm_reward": (("normalise_rewards",), "it divides by the deviation of a step's reward, not of returns"),
    "activation_fn": (("activation",), "a word, such as tanh"),
    "share_features_extractor": (("shared_trunk",), ""),
    "net_arch": (("policy_layers", "value_layers"), NETWORKS),
    "policy_kwargs": (("policy_layers", "value_layers"), NETWORKS),
    "agent_kwargs": (("policy_layers", "value_layers"), NETWORKS),
    "hidden_layer_sizes": (("policy_layers", "value_layers"), NETWORKS),
    "use_sde": ((), EXPLORATION),
    "sde_sample_freq": ((), EXPLORATION),
    "rollout_buffer_class": ((), STORAGE),
    "rollout_buffer_kwargs": ((), STORAGE),
    "stats_window_size": (("evaluate_every",), "a report is the mean since the last one"),
    "eval_freq": (("evaluate_every",), WHEN),
    "save_freq": (("checkpoint_every",), WHEN),
    "n_eval_episodes": (("evaluation_episodes",), ""),
    "num_eval_episodes": (("evaluation_episodes",), ""),
    "total_timesteps": (("frames",), ""),
    "env_id": (("env",), ""),
}
"""By the other packages' name: ours, if there are any, and what differs."""


def as_it_is(name: str) -> str:
    """A name as Python spells it."""
    return name


def our_name(name: object, spelt: Callable[[str], str] = as_it_is) -> str:
    """The end of a message about an unknown name: ours for it, or why there is none; empty where it is nobody's.

    Args:
        name: the unknown name.
        spelt: how a name of ours is written.
    """
    ours, note = OTHER_NAMES.get(name, ((), "")) if isinstance(name, str) else ((), "")
    if not ours:
        return f": {note}" if note else ""
    return f": here it is {' and '.join(map(spelt, ours))}{note and ' '}{note and f'({note})'}"
