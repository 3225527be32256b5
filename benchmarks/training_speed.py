"""Training speed with Table I's sizes, end to end, beside the floor that the machine's matrix products set.

Usage: python benchmarks/training_speed.py [ROBOT [FRAMES]], by default acrobot and 1,500,000 frames; leave the
machine idle. What is timed is `swingup train` without its display: rollouts, updates, an evaluation at 500 Hz
every 65,536 frames, checkpoints every 1,048,576, metrics and TensorBoard. The floor is the time that the matrix
products alone would take at the speed measured in the same process, before and after.
"""

import itertools
import resource
import tempfile
import time
from pathlib import Path

import jax
import jax.numpy as jnp
import tyro

from swingup.areapo.config import Config
from swingup.learner.presets import get_preset
from swingup.learner.run import start_run
from swingup.learner.run_settings import make_run_settings
from swingup.plant.plant import get_robot
from swingup.tasks.presets import get_task


def flops_per_frame(config: Config, observation_size: int) -> float:
    """Floating-point operations in matrix products for one frame of training, 2 for each multiply-add.

    An update's pass multiplies each weight matrix three times (forward, gradient of the weights, gradient of the
    inputs), the first layer's twice; a rollout evaluates both networks once.
    """

    def products(layers: tuple[int, ...]) -> tuple[int, int]:
        sizes = (observation_size, *layers, 2)
        macs = [size_in * size_out for size_in, size_out in itertools.pairwise(sizes)]
        return sum(macs), 3 * sum(macs) - macs[0]

    once, update = map(sum, zip(products(config.policy_layers), products(config.value_layers), strict=True))
    return 2.0 * (once + config.num_epochs * update)


def matmul_speed(config: Config) -> float:
    """Best measured speed of the update's largest product (FLOP/s)."""
    rows, width = config.batch_size, config.value_layers[-1]
    a = jax.random.normal(jax.random.key(0), (rows, width))
    b = jax.random.normal(jax.random.key(1), (width, width))
    multiply = jax.jit(jnp.matmul)
    multiply(a, b).block_until_ready()
    best = 0.0
    for _ in range(20):
        start = time.perf_counter()
        for _ in range(20):
            product = multiply(a, b)
        product.block_until_ready()
        best = max(best, 20 * 2.0 * rows * width * width / (time.perf_counter() - start))
    return best


def main(robot: str = "acrobot", frames: int = 1_500_000, /) -> None:
    """Time one run and print frames/s, the floor, their ratio, and the peak memory."""
    preset = get_preset("paper")
    config = preset.config
    settings = make_run_settings(robot, "paper")
    speed = matmul_speed(config)
    with tempfile.TemporaryDirectory() as folder:
        start = time.perf_counter()
        marks = []
        for report in start_run(settings, Path(folder) / "run", frames).advance():
            marks.append((time.perf_counter(), report.frames))
    total = marks[-1][1] / (marks[-1][0] - start)
    (first_time, first_frames), (last_time, last_frames) = marks[0], marks[-1]
    steady = (last_frames - first_frames) / (last_time - first_time)
    speed = max(speed, matmul_speed(config))
    floor = speed / flops_per_frame(config, get_task(preset.task, get_robot(robot)).observation_size)
    print(f"matrix products       {speed / 1e9:8.0f} GFLOP/s")
    print(f"floor                 {floor:8.0f} frames/s if nothing else took time")
    print(f"after compilation     {steady:8.0f} frames/s, {steady / floor:.2f} of the floor")
    print(f"with compilation      {total:8.0f} frames/s over {last_frames:,} frames")
    print(f"peak memory           {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:8.0f} MB")


if __name__ == "__main__":
    tyro.cli(main, description=__doc__)
