"""dm_control's acrobot-swingup: learnt in JAX from starts of its own, judged in MuJoCo.

Usage: python benchmarks/acrobot_swingup.py [--seeds 1] [--first-seed 0] [--study FILE] [--policies FOLDER]

Needs swingup[mujoco]. Finished runs are lines of the study's file and are not repeated: frames (steps of 10 ms),
the mean return of 128 episodes in MuJoCo, and seconds of the processor in training, compilation included.
`--seeds 0` trains nothing and shows what is finished. Policies are written as files.

The learner is the preset `fast` with other numbers, in two stages. The first starts most episodes on paths to
upright whose length is even on a logarithmic scale. The second has more of the long ones, and smaller steps.
"""

import argparse
import time
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from study import Study

from swingup.areapo import algorithm
from swingup.areapo.config import Config
from swingup.controllers.stack.policy import Policy, act, make_policy, save_policy
from swingup.learner.presets import get_preset
from swingup.policy.file import read_network
from swingup.tasks.acrobot_swingup import (
    MJCF,
    AcrobotPractice,
    AcrobotSwingup,
    magnified,
    torque_of,
    winnable_starts,
)

EPISODES, STEPS = 128, 1000
"""Of a judgement in MuJoCo; their seeds are not those of training."""
ACTION_REPEAT = 2
"""Steps of 10 ms for which an action is held in training; in MuJoCo the policy acts at each of them."""
COMMON = replace(
    get_preset("fast").config, gae_lambda=(0.97, 0.9), num_epochs=6, temperature=0.02, schedule="constant",
    gain="none", discount=(0.996, 0.996), centre_values=False,
)  # fmt: skip
COLUMNS = ("frames", "scores", "seconds")


class Stage(NamedTuple):
    """A part of the training, with other starts and another configuration."""

    pieces: int
    """Parts after each of which the policy is judged."""
    piece: int
    """Actions in a piece."""
    share: float
    """Of the episodes with starts of their own."""
    longest: int
    """Steps of the longest way from such a start to upright."""
    even: float
    """Share of those starts whose way is as likely short as long; of the others each power of ten is as likely."""
    config: Config


STAGES = (
    Stage(2, 10_000_000, 0.6, 1000, 0.0, COMMON),
    Stage(
        6, 5_000_000, 0.5, 400, 0.8,
        replace(COMMON, learning_rate=4e-4, temperature=0.015, schedule="anneal", schedule_frames=30_000_000),
    ),
)  # fmt: skip


def train(seed: int, path: Path) -> list[tuple[float, ...]]:
    """Train a seed; its points. The last policy is written to the path."""
    train = jax.jit(algorithm.train)
    points: list[tuple[float, ...]] = []
    state, frames, seconds = None, 0, 0.0
    for number, stage in enumerate(STAGES):
        key = jax.random.fold_in(jax.random.key(seed), number)
        starts = winnable_starts(jax.random.fold_in(key, 1), 2**17, stage.longest, stage.even)
        task = AcrobotPractice(
            action_repeat=ACTION_REPEAT, truncation_probability=0.004, starts=starts, start_share=stage.share
        )
        fresh = jax.jit(algorithm.init)(key, task, stage.config)
        if state is None:
            state = fresh
        else:
            # Environments and optimiser begin anew, and with them the schedule.
            networks = {name: getattr(state, name) for name in ("actor", "critic", "statistics", "gains")}
            seen = state.statistics.stage()(jax.vmap(task.observe)(fresh.task_states))
            state = replace(fresh, observations=seen, **networks)
        for _ in range(stage.pieces):
            iterations = round(stage.piece / stage.config.rollout_size)
            begun = time.process_time()
            state, _ = jax.block_until_ready(train(state, task, stage.config, iterations))
            seconds += time.process_time() - begun
            frames += iterations * stage.config.rollout_size * ACTION_REPEAT
            save_policy(path, Policy((state.statistics.stage(),), state.actor), {"seed": seed, "frames": frames})
            returns = judge(path, seed)
            points.append((frames, round(float(returns.mean()), 1), round(seconds, 1)))
            print(f"seed {seed}: {frames:,} frames, return {returns.mean():.1f}, {seconds:.0f} s", flush=True)
    return points


def judge(path: Path, seed: int) -> Float[np.ndarray, "episodes"]:
    """Returns of a policy file in MuJoCo, which sees and pays as dm_control does; 100 actions a second."""
    import mujoco  # type: ignore[import-untyped]

    policy = make_policy(read_network(path)[0])
    model = mujoco.MjModel.from_xml_string(MJCF)
    random = np.random.default_rng([seed, 1])
    episodes = [mujoco.MjData(model) for _ in range(EPISODES)]
    for data in episodes:
        data.qpos[:] = random.uniform(-np.pi, np.pi, 2)
        mujoco.mj_kinematics(model, data)
    pay = jax.jit(jax.vmap(AcrobotSwingup().reward))
    returns = np.zeros(EPISODES)
    for _ in range(STEPS):
        observations = np.array([_observe(data) for data in episodes])
        choices = act(policy, np.asarray(magnified(observations), np.float32))
        for data, control in zip(episodes, torque_of(choices), strict=True):
            data.ctrl[:] = control
            mujoco.mj_step(model, data)
            mujoco.mj_kinematics(model, data)
        states = np.array([[data.qpos[0] + np.pi, data.qpos[1], *data.qvel] for data in episodes])
        returns += np.asarray(pay(jnp.asarray(states)))
    return returns


def _observe(data: "mujoco.MjData") -> Float[np.ndarray, "6"]:  # type: ignore[name-defined]
    """Horizontal, then vertical directions of both links; the joints' velocities."""
    arms = data.xmat[1:].reshape(2, 3, 3)
    return np.concatenate([arms[:, 0, 2], arms[:, 2, 2], data.qvel])


def main() -> None:
    """Train the missing seeds and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--first-seed", type=int, default=0, help="seeds are this one and those that follow")
    parser.add_argument("--study", type=Path, default=Path("benchmarks/runs/acrobot-swingup.jsonl"))
    parser.add_argument("--policies", type=Path, default=Path("runs/acrobot-swingup"))
    options = parser.parse_args()
    for seed in range(options.first_seed, options.first_seed + options.seeds):
        if not Study(options.study).has(["acrobot-swingup"], seed):
            options.policies.mkdir(parents=True, exist_ok=True)
            points = train(seed, options.policies / f"{seed}.safetensors")
            Study(options.study).add(["acrobot-swingup"], seed, points, COLUMNS)
    curves = Study(options.study).of("acrobot-swingup")
    print("\n| frames | processor, s | mean return of the seeds | each |\n|---:|---:|---:|---|")
    for point, frames in enumerate(curves[0]["frames"] if curves else []):
        returns = [curve["scores"][point] for curve in curves]
        seconds = np.mean([curve["seconds"][point] for curve in curves])
        each = ", ".join(f"{value:.0f}" for value in returns)
        print(f"| {frames / 1e6:.0f} M | {seconds:.0f} | {np.mean(returns):.1f} | {each} |")


if __name__ == "__main__":
    main()
