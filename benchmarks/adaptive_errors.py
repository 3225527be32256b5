"""How far the identified base parameters are from the true ones along the closed loop, for `adaptive.py`."""

from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from swingup.benchmark.board import Case
from swingup.benchmark.robustness_board import RobustnessBoard
from swingup.benchmark.rollout import Scenario, apply_torque, initial_loop, measure
from swingup.benchmark.runner import stack
from swingup.common.files import write_atomically
from swingup.controllers.interface import AbstractController
from swingup.controllers.stack.estimator import EstimatingController
from swingup.plant.base_parameters import BASE, BASE_NAMES, base_parameters

RANGES = {
    "b1": (0.1, "N m s/rad"), "b2": (0.1, "N m s/rad"), "cf1": (0.2, "N m"), "cf2": (0.2, "N m"),
    "Ir": (1e-4, "kg m²"),
}  # fmt: skip
"""Largest values in the board's sweeps of what is 0 nominally: errors of these count relative to them."""
SECONDS, TIMES = 4.0, (0.5, 1.0, 2.0)
"""How long errors are followed, and when the table has them (s)."""
STRIDE = 0.05
"""Time between the rows that are kept (s)."""


def identified_bases(controller: AbstractController[Any], cases: list[Case], rules: RobustnessBoard) -> np.ndarray:
    """Base parameters that the identifier has found after each step, shape (cases, steps, 9).

    Args:
        controller: with an identifier.
        cases: the plants.
        rules: with the time of a step.
    """
    assert isinstance(controller, EstimatingController)
    identifier = controller.identifier
    assert identifier is not None

    @jax.jit
    @jax.vmap
    def run(scenario: Scenario) -> jax.Array:
        def step(carry: Any, index: jax.Array) -> tuple[Any, jax.Array]:
            before, memory = carry
            loop, measured, _ = measure(scenario, before, index, rules.dt)
            memory, command = controller(memory, index * rules.dt, measured)
            after = apply_torque(scenario, loop, index, command, rules.dt)
            found = controller.identified_plant(memory)
            assert found is not None
            return (after, memory), jnp.stack(found.theta)

        start = initial_loop(scenario, jnp.zeros(4), 1, rules.dt), controller.init()
        return jax.lax.scan(step, start, jnp.arange(round(SECONDS / rules.dt)))[1]

    with jax.enable_x64(True):
        return np.asarray(run(stack([case.scenario for case in cases])))


def error_bands(found: np.ndarray, true: np.ndarray) -> np.ndarray:
    """5th, 50th and 95th percentile over plants of the errors (%), shape (3, steps, 9).

    Args:
        found: base parameters (plants, steps, 9).
        true: of the plants (plants, 9).
    """
    scale = np.abs(true).copy()
    for name, (largest, _) in RANGES.items():
        scale[:, BASE_NAMES.index(name)] = largest
    return np.percentile(100 * np.abs(found - true[:, None]) / scale[:, None], [5, 50, 95], axis=0)


def relative_to(name: str) -> str:
    """What an error is a percentage of."""
    return "{:g} {}".format(*RANGES[name]) if name in RANGES else "its value"


def error_lines(time: np.ndarray, bands: np.ndarray) -> list[list[str]]:
    """Each parameter's median and band at a few times."""
    places = np.searchsorted(time, np.array(TIMES) - 1e-9)
    texts = [["{1:.1f} ({0:.1f} to {2:.1f})".format(*each) for each in bands[:, places, k].T] for k in range(BASE)]
    return [[f"{name}, % of {relative_to(name)}", *line] for name, line in zip(BASE_NAMES, texts, strict=True)]


def error_rows(time: np.ndarray, bands: np.ndarray) -> list[dict[str, Any]]:
    """A row for each parameter and every few steps."""
    every = round(STRIDE / (time[1] - time[0]))
    return [
        {"time": round(float(time[at]), 6), "parameter": name}
        | dict(zip(("low", "median", "high"), bands[:, at, k].tolist(), strict=True))
        for at in range(0, len(time), every)
        for k, name in enumerate(BASE_NAMES)
    ]


def follow_errors(
    controller: AbstractController[Any], cases: list[Case], rules: RobustnessBoard
) -> tuple[np.ndarray, np.ndarray]:
    """Times (s), and the percentiles of the errors over the plants (%) as :func:`error_bands` has them."""
    found = identified_bases(controller, cases, rules)
    true = np.array([base_parameters(case.scenario.parameters) for case in cases])
    return rules.dt * np.arange(found.shape[1]), error_bands(found, true)


def draw_errors(path: Path, time: np.ndarray, bands: np.ndarray) -> None:
    """A panel for each base parameter."""
    from swingup.report.draw import legend_below, line_look, new_figure, render, styled

    with styled():
        figure = new_figure(7.8, 6.0)
        panels = np.ravel(figure.subplots(3, 3, sharex=True))
        for k, (axes, name) in enumerate(zip(panels, BASE_NAMES, strict=True)):
            low, median, high = bands[:, :, k]
            (line,) = axes.plot(time, median, **line_look(0))
            band = axes.fill_between(time, low, high, color=line.get_color(), alpha=0.2, linewidth=0)
            axes.set(title=f"{name}, % of {relative_to(name)}", xlim=(0, time[-1]), ylim=(0, None))
            if k % 3 == 0:
                axes.set_ylabel("error (%)")
            if k >= 6:
                axes.set_xlabel("time (s)")
        legend_below(figure, [(line, "median of the draws"), (band, "90 % of the draws")])
        write_atomically(path, render(figure, path.suffix))
