"""The one optimiser of actor and critic: Adam with a clipped joint norm."""

import optax

from .config import Config


def make_optimiser(config: Config) -> optax.GradientTransformation:
    """Clip the joint norm of all gradients, then take Adam's step."""
    return optax.chain(
        optax.clip_by_global_norm(config.max_grad_norm),
        optax.scale_by_adam(eps=config.adam_epsilon),
        optax.scale(-config.learning_rate),
    )
