"""Speed of training on Gymnasium environments beside Stable-Baselines3's PPO with the same sizes, in turns.

Usage: python benchmarks/host_speed.py [ID [FRAMES [ROUNDS]]], by default HalfCheetah-v5, 40,960 frames and 3
rounds; leave the machine idle. Both step 8 environments one after another in one process, 256 steps a rollout, 10
epochs in minibatches of 64, networks of 64-64, no evaluation. Compilation and the first five rollouts, in which
episodes of 1,000 steps end once, are not timed.
"""

import time
from statistics import median

import tyro

from swingup import AREAPO

ENVS, STEPS, EPOCHS, BATCH, LAYERS = 8, 256, 10, 64, (64, 64)
ROLLOUT = ENVS * STEPS


class Ours:
    """AR-EAPO, which also learns an entropy value."""

    def __init__(self, task: str) -> None:
        self.model = AREAPO(
            task, num_envs=ENVS, num_steps=STEPS, num_epochs=EPOCHS, batch_size=BATCH, policy_layers=LAYERS,
            value_layers=LAYERS, evaluation_episodes=0,
        )  # fmt: skip

    def learn(self, frames: int) -> None:
        """Train for more frames."""
        self.model.learn(frames)


class Peer:
    """Stable-Baselines3's PPO."""

    def __init__(self, task: str) -> None:
        from stable_baselines3 import PPO
        from stable_baselines3.common.env_util import make_vec_env
        from stable_baselines3.common.vec_env import VecNormalize

        env = VecNormalize(make_vec_env(task, ENVS), norm_reward=False)
        layers = {"pi": list(LAYERS), "vf": list(LAYERS)}
        self.model = PPO(
            "MlpPolicy", env, n_steps=STEPS, batch_size=BATCH, n_epochs=EPOCHS, device="cpu",
            policy_kwargs={"net_arch": layers},
        )  # fmt: skip

    def learn(self, frames: int) -> None:
        """Train for more frames."""
        self.model.learn(frames, reset_num_timesteps=False)


def main(task: str = "HalfCheetah-v5", frames: int = 20 * ROLLOUT, rounds: int = 3, /) -> None:
    """Time both in turns and print the medians and their ratio."""
    learners: dict[str, Ours | Peer] = {"swingup AREAPO": Ours(task), "Stable-Baselines3 PPO": Peer(task)}
    rates: dict[str, list[float]] = {name: [] for name in learners}
    for learner in learners.values():
        learner.learn(5 * ROLLOUT)
    for _ in range(rounds):
        for name, learner in learners.items():
            start = time.perf_counter()
            learner.learn(frames)
            rates[name].append(frames / (time.perf_counter() - start))
    for name, values in rates.items():
        print(f"{name:24} {median(values):8.0f} frames/s (from {min(values):.0f} to {max(values):.0f})")
    ours, peer = (median(values) for values in rates.values())
    print(f"{'ratio':24} {ours / peer:8.2f}")


if __name__ == "__main__":
    tyro.cli(main, description=__doc__)
