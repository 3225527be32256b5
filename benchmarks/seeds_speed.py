"""Frames a second of compiled training, with so many seeds side by side under `vmap`, on JAX's default device.

Usage: python benchmarks/seeds_speed.py [PRESET:SEEDS ...]; default: fast with 1, 64 and 1,024 seeds,
dm-acrobot with 10, and paper with 1 and 2. A frame is an action. Neither compilation nor evaluations count.
"""

import time

import jax
import tyro

from swingup.areapo import algorithm
from swingup.learner.presets import ACROBOT_PRESET, get_preset
from swingup.plant.plant import get_robot
from swingup.tasks.acrobot_swingup import acrobot_practice
from swingup.tasks.presets import get_task

DEFAULT = "fast:1", "fast:64", "fast:1024", f"{ACROBOT_PRESET}:10", "paper:1", "paper:2"
SECONDS = 4.0
"""Of a measurement, about."""


def measure(name: str, seeds: int) -> float:
    """Frames a second of all seeds of a preset."""
    preset = get_preset(name)
    task = acrobot_practice() if name == ACROBOT_PRESET else get_task(preset.task, get_robot("acrobot"))
    init = jax.jit(jax.vmap(algorithm.init, in_axes=(0, None, None)))
    train = jax.jit(jax.vmap(algorithm.train, in_axes=(0, None, None, None)))
    state = init(jax.random.split(jax.random.key(0), seeds), task, preset.config)

    def seconds(iterations: int) -> float:
        start = time.perf_counter()
        jax.block_until_ready(train(state, task, preset.config, iterations))
        return time.perf_counter() - start

    seconds(1)  # compiles
    iterations = max(1, round(SECONDS / seconds(1)))
    return seeds * iterations * preset.config.rollout_size / seconds(iterations)


def main(words: tuple[str, ...] = DEFAULT, /) -> None:
    """Measure and print the table."""
    print(f"{jax.devices()[0].device_kind}, JAX {jax.__version__}\n")
    print("| preset | seeds | frames/s | of one seed |\n|---|---:|---:|---:|")
    for word in words:
        name, seeds = word.split(":")
        speed = measure(name, int(seeds))
        print(f"| {name} | {seeds} | {speed:,.0f} | {speed / int(seeds):,.0f} |", flush=True)


if __name__ == "__main__":
    tyro.cli(main, description=__doc__)
