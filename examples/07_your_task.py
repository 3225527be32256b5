"""Train AR-EAPO on a task of your own: a pump keeps the level of a leaky tank, without end.

Usage: python examples/07_your_task.py [FRAMES]. The default, 20,000 frames, takes seconds.
"""

import sys

import gymnasium
import numpy as np
from gymnasium.spaces import Box

from swingup import AREAPO
from swingup.learner.progress import TrainingReport


class Tank(gymnasium.Env[np.ndarray, np.ndarray]):
    """The level (m) falls by a tenth a step and by a random amount; the pump adds up to 0.5 m."""

    observation_space = Box(0.0, np.inf, (1,), np.float32)
    action_space = Box(0.0, 0.5, (1,), np.float32)

    def reset(self, *, seed: int | None = None, options: dict | None = None) -> tuple[np.ndarray, dict]:
        """Start at any level."""
        super().reset(seed=seed)
        self.level, self.steps = self.np_random.uniform(0.0, 4.0), 0
        return np.array([self.level], np.float32), {}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict]:
        """Reward the level for being near 2 m. Only a time limit truncates an episode."""
        self.level = 0.9 * self.level + float(action[0]) - self.np_random.uniform(0.0, 0.04)
        self.level, self.steps = max(self.level, 0.0), self.steps + 1
        return np.array([self.level], np.float32), -((self.level - 2.0) ** 2), False, self.steps >= 200, {}


def main(frames: int) -> None:
    """Learn, print the gain meanwhile, and print the policy's actions."""
    model = AREAPO(Tank, "continuing", learning_rate=1e-3, evaluate_every=4096)

    def show(_: AREAPO, report: TrainingReport) -> None:
        print(f"{report.frames:6,} frames: gain {report.best.gain:.3f}, mean return {report.score:.1f}")

    model.learn(frames, show)
    for level in (1.0, 2.0, 3.0):
        print(f"at {level} m it pumps {model.predict([level])[0][0]:.2f} m a step")  # 0.22 m a step keeps 2 m
    print(model.evaluate(episodes=10))


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 20_000)
