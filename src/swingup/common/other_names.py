"""Names that Stable-Baselines3, CleanRL and rejax give to hyperparameters, and ours.

A name is not taken for ours, since most of them mean something slightly different: an error says what to write, and
``docs/coming-from.md`` what differs.
"""

OTHER_NAMES = {
    "n_envs": "num_envs",
    "n_steps": "num_steps",
    "n_epochs": "num_epochs",
    "update_epochs": "num_epochs",
    "num_minibatches": "batch_size",
    "lr": "learning_rate",
    "gamma": "discount",
    "ent_coef": "temperature",
    "vf_coef": "value_coefficient",
    "clip_coef": "clip_range",
    "clip_eps": "clip_range",
    "net_arch": "policy_layers and value_layers",
    "policy_kwargs": "policy_layers and value_layers",
    "total_timesteps": "frames, an argument of learn",
}
"""By the other packages' names: ours."""


def swingup_name(name: object) -> str:
    """The end of a message about an unknown name: our name for it; empty if we have none."""
    ours = OTHER_NAMES.get(name) if isinstance(name, str) else None
    return f": here it is {ours}" if ours else ""
