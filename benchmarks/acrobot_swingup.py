"""Policies of dm_control's acrobot-swingup, judged in MuJoCo.

Usage: python benchmarks/acrobot_swingup.py FILE [FILE ...] [--episodes 128]

FILE is a policy of `swingup train --env swingup/AcrobotSwingup-v0`. Needs swingup[mujoco]. Each policy plays other
episodes from dm_control's starts, and acts at 100 Hz. Prints its mean return (of 1,000) with the standard error,
the return of the sparse task, the share of episodes that stand in the target for the last 2 s, the median time
until the tip is there first, and the share with a return below 100; then Student's interval over the files.
"""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy.stats import ttest_1samp

from swingup.policy.shipped import load_policy
from swingup.tasks.acrobot_swingup import MJCF, AcrobotSwingup

if TYPE_CHECKING:
    from mujoco import MjData

STEPS, DT, LAST = 1000, 0.01, 200
"""Of an episode, the time of a step (s), and how many steps must be in the target at the end."""
FAILED = 100.0
"""A return below which a policy did not swing up."""


def judge(path: Path, seed: int, episodes: int) -> Float[np.ndarray, "episodes steps"]:
    """Rewards of a policy file in MuJoCo, which sees and pays as dm_control does; 100 actions a second."""
    import mujoco

    policy = load_policy(path)
    model = mujoco.MjModel.from_xml_string(MJCF)
    random = np.random.default_rng([seed, 1])
    data = [mujoco.MjData(model) for _ in range(episodes)]
    for each in data:
        each.qpos[:] = random.uniform(-np.pi, np.pi, 2)
        mujoco.mj_kinematics(model, each)
    pay = jax.jit(jax.vmap(AcrobotSwingup().reward))
    rewards = np.zeros((episodes, STEPS))
    for step in range(STEPS):
        observations = np.array([_observe(each) for each in data])
        for each, control in zip(data, policy.predict(observations)[0], strict=True):
            each.ctrl[:] = control
            mujoco.mj_step(model, each)
            mujoco.mj_kinematics(model, each)
        states = np.array([[each.qpos[0] + np.pi, each.qpos[1], *each.qvel] for each in data])
        rewards[:, step] = pay(jnp.asarray(states))
    return rewards


def _observe(data: "MjData") -> Float[np.ndarray, "6"]:
    """Horizontal, then vertical directions of both links; the joints' velocities."""
    arms = data.xmat[1:].reshape(2, 3, 3)
    return np.concatenate([arms[:, 0, 2], arms[:, 2, 2], data.qvel])


def row_of(path: Path, rewards: Float[np.ndarray, "episodes steps"]) -> str:
    """A line of the table."""
    returns, there = rewards.sum(axis=1), rewards >= 1.0
    arrival = np.where(there.any(axis=1), DT * there.argmax(axis=1), np.inf)
    error = returns.std(ddof=1) / np.sqrt(len(returns))
    cells = [
        path.stem, f"{returns.mean():.0f} ± {error:.0f}", f"{there.sum(axis=1).mean():.0f}",
        f"{100 * there[:, -LAST:].all(axis=1).mean():.0f} %",
        f"{np.median(arrival):.1f} s", f"{100 * (returns < FAILED).mean():.0f} %",
    ]  # fmt: skip
    return f"| {' | '.join(cells)} |"


def main() -> None:
    """Judge the files and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE")
    parser.add_argument("--episodes", type=int, default=128)
    options = parser.parse_args()
    print("| policy | return | sparse | stands for the last 2 s | first there | return below 100 |")
    print("|---" + "|---:" * 5 + "|")
    means = []
    for seed, path in enumerate(options.files):
        rewards = judge(path, seed, options.episodes)
        means.append(rewards.sum(axis=1).mean())
        print(row_of(path, rewards), flush=True)
    if len(means) > 1:
        low, high = ttest_1samp(means, 0.0).confidence_interval()
        print(f"\n{np.mean(means):.0f} ({low:.0f} to {high:.0f}; 95 %) over {len(means)} policies")


if __name__ == "__main__":
    main()
