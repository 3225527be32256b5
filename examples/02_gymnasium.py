"""Run a random policy on the acrobot through Gymnasium and save a picture of the last state.

Usage: python examples/02_gymnasium.py [PNG]. The default is acrobot.png in the current folder. Needs
swingup[render].
"""

import sys
from pathlib import Path

import gymnasium
import numpy as np
from PIL import Image

import swingup.gym  # noqa: F401 (registers swingup/Acrobot-v0 and swingup/Pendubot-v0)


def main(path: Path) -> None:
    """Take 200 random steps (two seconds) and save the last frame."""
    env = gymnasium.make("swingup/Acrobot-v0", render_mode="rgb_array")
    env.reset(seed=0)
    env.action_space.seed(0)
    total = 0.0
    for _ in range(200):
        _, reward, terminated, truncated, info = env.step(env.action_space.sample())
        total += float(reward)
        if terminated or truncated:  # never terminated; truncated at random, once in 1,000 steps
            _, info = env.reset()
    q1, q2, _, _ = info["state"]
    print(f"mean reward {total / 200:.3f}; last angles {q1:.2f} and {q2:.2f} rad")
    Image.fromarray(np.asarray(env.render())).save(path)
    print(f"saved {path}")
    env.close()


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "acrobot.png"))
