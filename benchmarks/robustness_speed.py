"""Time of the robustness benchmark's 722 simulations, beside the same simulations run one by one.

Usage: python benchmarks/robustness_speed.py [ROBOT [CONTROLLER...]], by default acrobot with ar-eapo, adaptive,
tvlqr and ilqr-riccati; leave the machine idle. Times are after compilation, the best of three. The peer is the
public code's way: one simulation after another, one call of the controller and one of the integrator a step, here
in NumPy. It is timed on a few seconds of simulation in the same process and scaled to the grid.
"""

import dataclasses
import time
from collections.abc import Callable

import numpy as np
import tyro

from swingup.benchmark.boards import ROBUSTNESS
from swingup.benchmark.judge import judge
from swingup.benchmark.robustness_board import CRITERIA, make_cases
from swingup.controllers.registry import get_controller
from swingup.controllers.stack.policy import PolicyController
from swingup.plant.plant import LEADERBOARD, Plant, get_robot

CONTROLLERS = "ar-eapo", "adaptive", "tvlqr", "ilqr-riccati"
SAMPLE = 2000
"""Steps that the peer is timed on."""


def best_of(repetitions: int, work: Callable[[], object]) -> float:
    """Least wall-clock time of a piece of work (s)."""
    times = []
    for _ in range(repetitions):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return min(times)


def derivative(p: Plant, x: np.ndarray, u: np.ndarray) -> np.ndarray:
    """ẋ of the frictionless pendulum in NumPy, as a plain simulator computes it."""
    q1, q2, dq1, dq2 = x
    h = p.m2 * p.l1 * p.r2
    m12 = p.I2 + h * np.cos(q2)
    mass = np.array([[p.I1 + p.I2 + p.m2 * p.l1**2 + 2 * h * np.cos(q2), m12], [m12, p.I2]])
    coriolis = h * np.sin(q2) * np.array([-dq2 * (2 * dq1 + dq2), dq1 * dq1])
    g2 = -p.m2 * p.g * p.r2 * np.sin(q1 + q2)
    gravity = np.array([-(p.m1 * p.r1 + p.m2 * p.l1) * p.g * np.sin(q1) + g2, g2])
    return np.concatenate([x[2:], np.linalg.solve(mass, u + gravity - coriolis)])


def rk4(p: Plant, x: np.ndarray, u: np.ndarray, dt: float) -> np.ndarray:
    """One Runge-Kutta step in NumPy."""
    k1 = derivative(p, x, u)
    k2 = derivative(p, x + 0.5 * dt * k1, u)
    k3 = derivative(p, x + 0.5 * dt * k2, u)
    k4 = derivative(p, x + dt * k3, u)
    return x + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


def one_by_one(controller: PolicyController, steps: int) -> None:
    """A plain simulation: the policy's network in NumPy, then a step of the pendulum."""
    p = LEADERBOARD.driven(controller.robot)
    actor = controller.policy.actor
    layers = [(np.asarray(layer.weight), np.asarray(layer.bias)) for layer in (*actor.trunk, actor.mean_head)]
    x, actuation = np.zeros(4), np.array(controller.robot.actuation)
    for _ in range(steps):
        y = np.array([np.sin(x[0]), np.cos(x[0]), np.sin(x[1]), np.cos(x[1]), x[2] / 20, x[3] / 20], np.float32)
        for weight, bias in layers[:-1]:
            y = np.maximum(weight @ y[: weight.shape[1]] + bias, 0)
        u = controller.torque_limit * np.tanh(layers[-1][0] @ y + layers[-1][1]) * actuation
        x = rk4(p, x, np.clip(u, -6.0, 6.0), 0.002)


def main(robot_name: str = "acrobot", controllers: tuple[str, ...] = CONTROLLERS, /) -> None:
    """Print one line for each controller."""
    robot, rules = get_robot(robot_name), ROBUSTNESS
    simulations = sum(len(make_cases(robot, rules, criterion, 0)) for criterion in CRITERIA)
    policy = get_controller("ar-eapo", robot)
    assert isinstance(policy, PolicyController)
    peer = best_of(3, lambda: one_by_one(policy, SAMPLE)) / SAMPLE * rules.steps * simulations
    print(f"{robot.name}: {simulations} simulations of {rules.steps} steps")
    print(f"one by one in NumPy (a 256-256 policy): {peer:.0f} s, scaled from {SAMPLE} steps")
    for name in controllers:
        controller = get_controller(name, robot)
        start = time.perf_counter()
        judge(controller, robot, dataclasses.replace(rules), name=name)
        first = time.perf_counter() - start
        again = best_of(3, lambda: judge(controller, robot, rules, name=name))  # noqa: B023 - used at once
        print(
            f"{name:<14}{again:7.2f} s  {peer / again:6.0f} times as fast as one by one (first run {first:.1f} s)"
        )


if __name__ == "__main__":
    tyro.cli(main, description=__doc__)
