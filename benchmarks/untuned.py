"""The default, and others, on tasks for which nothing was chosen.

Usage: python benchmarks/untuned.py [TASK ...] [--frames 300000] [--seeds 1] [--first-seed 500]
[--learners default] [--changes plain] [--file benchmarks/runs/untuned.csv]

A learner is `default`, a preset's name, or `sb3-ppo`, Stable-Baselines3's PPO of `mujoco_learning.py`. A change is
`plain`; `offset`, 1,000 more on every reward; `small`, rewards times 1e-3; or `observed`, observations times 1e-4.
CartPoleSwingup and RotaryPendulum are of this file: dm_control's cart-pole with its rewards, and an arm of 0.15 m
that turns without limits and swings up a rod of 0.2 m. Neither ends before its 1,000 steps. Names that begin with
gymnax/ are gymnax's, which ours trains on as they are and the peer through gymnax's own wrapper.
Needs swingup[mujoco], for its tasks gymnasium[box2d] or swingup[gymnax], and stable-baselines3 for the peer.

Finished runs are rows of the file and are not repeated: the mean return of the last policy in 20 deterministic
episodes, in the task's own rewards, seconds of the processor, with compilation and judgement, and the package's
commit, which rows before 2026-12 lack. `--seeds 0` trains nothing and shows what is finished, with how many seeds
learned where the task has a threshold.
"""

import argparse
import csv
import functools
import itertools
import time
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium.wrappers import TimeLimit, TransformObservation, TransformReward
from study import code_version

from swingup import AREAPO

EPISODES = 20
GYMNAX = "gymnax/"
LEARNED = {"MountainCarContinuous-v0": 90.0, "Acrobot-v1": -110.0, "Pendulum-v1": -200.0}
"""Mean returns from which a seed counts as learned."""
COLUMNS = ("task", "change", "learner", "seed", "frames", "score", "cpu_seconds", "code")

CART = """<mujoco><option timestep="0.01" integrator="RK4"><flag contact="disable" energy="enable"/></option>
<worldbody><body name="cart" pos="0 0 1"><joint name="slider" type="slide" axis="1 0 0" limited="true"
range="-1.8 1.8" solreflimit=".08 1" damping="5e-4"/><geom type="box" size="0.2 0.15 0.1" mass="1"/>
<body name="pole"><joint name="hinge" axis="0 1 0" damping="2e-6"/>
<geom type="capsule" fromto="0 0 0 0 0 1" size="0.045" mass=".1"/></body></body></worldbody>
<actuator><motor joint="slider" gear="10" ctrllimited="true" ctrlrange="-1 1"/></actuator></mujoco>"""
ROTARY = """<mujoco><option timestep="0.005" integrator="RK4"><flag contact="disable"/></option>
<worldbody><body pos="0 0 1"><joint name="arm" axis="0 0 1" damping="5e-4"/>
<geom type="capsule" fromto="0 0 0 0.15 0 0" size="0.006" mass="0.1"/>
<body pos="0.15 0 0"><joint name="rod" axis="1 0 0" damping="2e-5"/>
<geom type="capsule" fromto="0 0 0 0 0 0.2" size="0.005" mass="0.03"/></body></body></worldbody>
<actuator><motor joint="arm" gear="0.03" ctrllimited="true" ctrlrange="-1 1"/></actuator></mujoco>"""


class Swingup(gymnasium.Env[Any, Any]):
    """A rod that hangs from a cart or an arm of MuJoCo; one action moves what it hangs from."""

    action_space = gymnasium.spaces.Box(-1.0, 1.0, (1,), np.float32)

    def __init__(self, mjcf: str, repeat: int) -> None:
        """Load a model whose upright rod is at the angle 0."""
        import mujoco

        self._mujoco, self._repeat = mujoco, repeat
        self._model = mujoco.MjModel.from_xml_string(mjcf)
        self._data = mujoco.MjData(self._model)
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (len(self._observe()),), np.float32)

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        """Hang the rod down, almost at rest."""
        super().reset(seed=seed)
        self._mujoco.mj_resetData(self._model, self._data)
        self._data.qpos[:] = np.array([0.0, np.pi]) + 0.01 * self.np_random.normal(size=2)
        self._data.qvel[:] = 0.01 * self.np_random.normal(size=2)
        return self._observe(), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Act for 10 ms (the cart) or 20 ms (the arm)."""
        control = float(np.clip(action[0], -1.0, 1.0))
        self._data.ctrl[0] = control
        self._mujoco.mj_step(self._model, self._data, self._repeat)
        return self._observe(), self._reward(control), False, False, {}

    def _observe(self) -> Any:
        (place, angle), velocities = self._data.qpos, self._data.qvel
        return np.array([place, np.cos(angle), np.sin(angle), *velocities], np.float32)

    def _reward(self, control: float) -> float:
        """dm_control's: the product of upright, centred, gentle and slow."""
        (place, angle), velocity = self._data.qpos, self._data.qvel[1]
        # A margin's end is worth 0.1.
        centred, slow = 0.1 ** ((place / 2.0) ** 2), 0.1 ** ((velocity / 5.0) ** 2)
        return float((1.0 + np.cos(angle)) * (1.0 + centred) * (5.0 - control**2) * (1.0 + slow) / 40.0)


class Rotary(Swingup):
    """A Furuta pendulum."""

    def _observe(self) -> Any:
        (turn, angle), velocities = self._data.qpos, self._data.qvel
        return np.array([np.cos(turn), np.sin(turn), np.cos(angle), np.sin(angle), *velocities], np.float32)

    def _reward(self, control: float) -> float:
        """How upright the rod is, less for torque and a fast arm."""
        speed = self._data.qvel[0] / 20.0
        return float((1.0 + np.cos(self._data.qpos[1])) * (5.0 - control**2) / (10.0 * (1.0 + speed**2)))


def make(task: str, change: str = "plain") -> gymnasium.Env[Any, Any]:
    """A task by its name, changed."""
    env: gymnasium.Env[Any, Any]
    if task == "CartPoleSwingup":
        env = TimeLimit(Swingup(CART, 1), 1000)
    elif task == "RotaryPendulum":
        env = TimeLimit(Rotary(ROTARY, 4), 1000)
    elif task.startswith(GYMNAX):
        import gymnax
        from gymnax.wrappers.gym import GymnaxToGymWrapper

        env = GymnaxToGymWrapper(*gymnax.make(task.removeprefix(GYMNAX)))
    else:
        env = gymnasium.make(task)
    if change == "observed":
        space: Any = env.observation_space
        smaller = gymnasium.spaces.Box(space.low * 1e-4, space.high * 1e-4, dtype=np.float64)
        return TransformObservation(env, lambda seen: seen * 1e-4, smaller)
    if change == "plain":
        return env
    return TransformReward(env, {"offset": lambda paid: paid + 1000.0, "small": lambda paid: 1e-3 * paid}[change])


def train(task: str, change: str, learner: str, seed: int, frames: int) -> float:
    """The mean return of the last policy, in the task's own rewards."""
    if learner == "sb3-ppo":
        return peer_score(task, change, seed, frames)
    preset = None if learner == "default" else learner
    reports: dict[str, Any] = {
        "evaluate_every": frames,
        "checkpoint_every": frames,
        "evaluation_episodes": EPISODES,
    }
    env: Any = functools.partial(make, task, change)
    if task.startswith(GYMNAX) and change == "plain":
        import gymnax

        env = gymnax.make(task.removeprefix(GYMNAX))
    model = AREAPO(env, preset, seed, **reports)
    rows: list[dict[str, Any]] = []
    model.learn(frames, lambda _, report: rows.append(report.best.as_dict()))
    model.close()
    score, length = rows[-1]["score"], rows[-1]["mean_length"]
    return {"offset": score - 1000.0 * length, "small": 1e3 * score}.get(change, score)


def peer_score(task: str, change: str, seed: int, frames: int) -> float:
    """The same of the peer."""
    from mujoco_learning import ENVS, STEPS
    from stable_baselines3 import PPO
    from stable_baselines3.common.env_util import make_vec_env
    from stable_baselines3.common.evaluation import evaluate_policy
    from stable_baselines3.common.vec_env import VecNormalize

    env = VecNormalize(make_vec_env(lambda: make(task, change), ENVS, seed=seed))
    model = PPO("MlpPolicy", env, n_steps=STEPS, seed=seed, device="cpu").learn(frames)
    judge = VecNormalize(make_vec_env(lambda: make(task), 1, seed=seed), training=False, norm_reward=False)
    judge.obs_rms = env.obs_rms
    return float(np.mean(evaluate_policy(model, judge, EPISODES)[0]))


def main() -> None:
    """Train the missing runs and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tasks", nargs="*", default=list(LEARNED), metavar="TASK")
    parser.add_argument("--frames", type=int, default=300_000)
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--first-seed", type=int, default=500, help="seeds are this one and those that follow")
    parser.add_argument("--learners", nargs="+", default=["default"])
    parser.add_argument("--changes", nargs="+", default=["plain"], choices=["plain", "offset", "small", "observed"])
    parser.add_argument("--file", type=Path, default=Path("benchmarks/runs/untuned.csv"))
    options = parser.parse_args()
    if not options.file.exists():
        options.file.write_text(",".join(COLUMNS) + "\n")
    done = [tuple(row.values())[:5] for row in csv.DictReader(options.file.open())]
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    for seed, task, change, learner in itertools.product(seeds, options.tasks, options.changes, options.learners):
        key = (task, change, learner, str(seed), str(options.frames))
        if key in done:
            continue
        start = time.process_time()
        score = train(task, change, learner, seed, options.frames)
        row = (*key, f"{score:.2f}", f"{time.process_time() - start:.1f}", code_version())
        with options.file.open("a") as file:
            file.write(",".join(row) + "\n")
        print(*row, flush=True)
    print("\n| task | change | learner | frames | scores | learned | CPU-seconds a run |")
    print("|---" * 7 + "|")
    groups: dict[tuple[str, ...], list[dict[str, str]]] = {}
    for line in csv.DictReader(options.file.open()):
        if int(line["seed"]) not in seeds or line["frames"] != str(options.frames):
            continue
        groups.setdefault(tuple(line[each] for each in ("task", "change", "learner", "frames")), []).append(line)
    for (task, change, learner, count), lines in groups.items():
        scores = sorted(float(line["score"]) for line in lines)
        learned = f"{sum(each >= LEARNED[task] for each in scores)} of {len(scores)}" if task in LEARNED else ""
        shown = ", ".join(f"{each:.0f}" for each in scores)
        cost = np.mean([float(line["cpu_seconds"]) for line in lines])
        print(f"| {task} | {change} | {learner} | {int(count):,} | {shown} | {learned} | {cost:.0f} |")


if __name__ == "__main__":
    main()
