"""dm_control's acrobot-swingup: learnt in JAX from starts of its own, judged in MuJoCo.

Usage: python benchmarks/acrobot_swingup.py [--seeds 1] [--first-seed 0] [--study FILE] [--policies FOLDER]

Needs swingup[mujoco]. Finished runs are lines of the study's file and are not repeated: frames (steps of 10 ms),
the mean return of 128 episodes in MuJoCo, and seconds of the processor, evaluations in JAX and compilation
included. `--seeds 0` trains nothing and shows what is finished. Policies are written as files.
"""

import argparse
import time
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from study import Study

from swingup import AREAPO
from swingup.learner.presets import ACROBOT_PRESET, get_preset
from swingup.learner.progress import TrainingReport
from swingup.policy.shipped import load_policy
from swingup.tasks.acrobot_swingup import ACTION_REPEAT, MJCF, AcrobotSwingup

ID, PRESET = "swingup/AcrobotSwingup-v0", ACROBOT_PRESET
EPISODES, STEPS = 128, 1000
"""Of a judgement in MuJoCo; their seeds are not those of training."""
EVERY, JUDGEMENTS = 1220 * get_preset(PRESET).config.rollout_size, 10
"""Actions between judgements, nearly 10 million, and how many there are: the preset's run. In MuJoCo an action
lasts for one step."""
COLUMNS = ("frames", "scores", "seconds")


def train(seed: int, path: Path) -> list[tuple[float, ...]]:
    """Train a seed; its points. The last policy is written to the path."""
    points: list[tuple[float, ...]] = []
    judging, start = 0.0, time.process_time()

    def note(model: AREAPO, report: TrainingReport) -> None:
        nonlocal judging
        begun = time.process_time()
        model.export_policy(path)
        returns, frames = judge(path, seed), ACTION_REPEAT * report.frames
        points.append((frames, round(float(returns.mean()), 1), round(begun - start - judging, 1)))
        print(f"seed {seed}: {frames:,} frames, return {returns.mean():.1f}, {points[-1][2]:.0f} s", flush=True)
        judging += time.process_time() - begun

    AREAPO(ID, PRESET, seed, evaluate_every=EVERY, checkpoint_every=EVERY).learn(JUDGEMENTS * EVERY, note)
    return points


def judge(path: Path, seed: int) -> Float[np.ndarray, "episodes"]:
    """Returns of a policy file in MuJoCo, which sees and pays as dm_control does; 100 actions a second."""
    import mujoco

    policy = load_policy(path)
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
        for data, control in zip(episodes, policy.predict(observations)[0], strict=True):
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
