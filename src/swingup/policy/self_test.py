"""Self-tests of exports: sixteen observations with their actions, or short runs of a controller with its torques.

An export carries one, and answers it where it runs: the folders when they are loaded, a C header in
``swingup_self_test``, an ONNX graph by the entry ``self_test`` of its metadata.
"""

import json
import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..common.checks import LARGEST_NUMBER
from ..common.errors import MALFORMED, SwingupError, naming
from ..common.files import read_bytes
from ..plant.equations import NUMPY, damped_midpoint_step
from ..plant.plant import Robot, lump
from ..plant.units import arm_scales
from .contract import LoopController
from .feedback import FILE as LAW_FILE
from .feedback import RobotPolicy, policy_controller, read_feedback
from .guard import GuardChoice
from .network import NormaliseStage
from .pendulum import PendulumPolicy, read_pendulum_policy
from .policy import NumpyNetwork, TaskPolicy, read_task_policy

TESTS = 16  # Observations of a test, or calls in a run
CANDIDATES = 4 * TESTS  # Of discrete actions, whose best logits must lie apart
SHARE, LOOP_SHARE = 1e-4, 1e-3
"""Of an action's range: how far answers may lie apart. An estimator amplifies rounding of single precision."""
PERIOD = 0.002  # Time between calls of a controller that has no period of its own (s)
STARTS = ((0.4, -0.3, 2.0, -1.5), (math.pi - 0.03, 0.02, 0.1, -0.1))
"""First states of the runs: one swings, the other is near the top, where a regulator acts; rates in C.1's units."""
FILE, MAX_BYTES = "self_test.json", 100_000_000


@dataclass(frozen=True)
class SelfTest:
    """Observations, or states (rad, rad/s), and the answers to them; the first axis counts them."""

    observations: np.ndarray
    actions: np.ndarray
    tolerance: np.ndarray
    """How far each number of an action may differ; 0 for discrete ones."""
    calls: int = 1
    """Calls of a run: a controller is reset before each run."""
    period: float = PERIOD
    """Time between a controller's calls, the first of which is at 0 (s)."""

    def to_json(self) -> str:
        """An object of the fields by their names."""
        values = asdict(self).items()
        return json.dumps({name: each.tolist() if isinstance(each, np.ndarray) else each for name, each in values})

    def check(self, answer: Callable[[np.ndarray, int], Any]) -> None:
        """Compare with a function of an observation and its number in its run.

        Raises:
            SwingupError: an answer differs.
        """
        for index, (observation, expected) in enumerate(zip(self.observations, self.actions, strict=True)):
            found = np.asarray(answer(observation, index % self.calls))
            # Negated, so that NaN fails.
            if not np.all(np.abs(found - expected) <= self.tolerance):
                raise SwingupError(
                    f"its self-test fails at observation {index + 1} of {len(self.actions)}: it gives "
                    f"{found.tolist()}, not {expected.tolist()}; export the policy again"
                )


def task_test(policy: TaskPolicy) -> SelfTest:
    """A test of a task's policy: observations as the normalisation expects them, within their bounds."""
    seen, space, rng = policy.observation_space, policy.action_space, np.random.default_rng(0)
    rows = rng.normal(size=(CANDIDATES, seen.size))
    for stage in policy.network.stages:
        if isinstance(stage, NormaliseStage):
            rows = stage.mean + stage.deviation * rows
    if seen.low is not None:
        rows = rows.clip(np.ravel(seen.low), np.ravel(seen.high))
    # In single precision a program may see nothing else.
    rows = rows.astype(np.float32).astype(seen.dtype)
    if space.choices:
        logits = NumpyNetwork(policy.folded)(rows.astype(np.float64))
        parts = np.split(logits, np.cumsum(space.choices)[:-1], axis=-1)
        ordered = [np.sort(part, axis=-1) for part in parts if part.shape[-1] > 1]
        leads = np.min([part[:, -1] - part[:, -2] for part in ordered] or [np.ones(CANDIDATES)], axis=0)
        rows = rows[leads >= np.median(leads)]
    observations = rows[:TESTS].reshape(TESTS, *seen.shape)
    tolerance = np.zeros(space.shape)
    if not space.choices:
        low, high = (np.asarray(bound, float) for bound in (space.low, space.high))
        # Answers are rounded to the space's type, such as halves or whole numbers.
        largest, whole = np.maximum(np.abs(low), np.abs(high)), np.dtype(space.dtype).kind != "f"
        step = 1.0 if whole else np.spacing(largest.astype(space.dtype)).astype(float)
        tolerance = np.maximum(SHARE * (high - low), step)
    return SelfTest(observations, policy.predict(observations)[0], tolerance)


def loop_test(policy: RobotPolicy) -> SelfTest:
    """A test of a pendulum's controller as it is, with its guard: two runs where it has a memory."""
    controller, units = policy_controller(policy), np.array(arm_scales(policy.plant).state)
    period, tolerance = policy.period or PERIOD, 2 * LOOP_SHARE * np.array(policy.torque_limits)
    if isinstance(policy, PendulumPolicy) and policy.estimator is None and policy.regulator is None:
        starts, calls = np.random.default_rng(0).uniform(-1, 1, (TESTS, 4)) * [math.pi, math.pi, 9.0, 9.0], 1
    else:
        starts, calls = np.array(STARTS), TESTS
    plant, states, torques = lump(policy.plant), [], []
    for x in starts * units:
        controller.reset()
        for call in range(calls):
            if not (np.abs(x) < LARGEST_NUMBER).all():
                raise SwingupError("its pendulum flies apart in the self-test: check the plant's numbers")
            # In single precision a program may see nothing else.
            states.append(x.astype(np.float32).astype(np.float64))
            torques.append(controller(states[-1], period * call))
            x = np.array(damped_midpoint_step(plant, policy.plant.friction, x, torques[-1], period, NUMPY))
    return SelfTest(np.array(states), np.array(torques), tolerance, calls, period)


def load_tested_policy(folder: Path) -> TaskPolicy:
    """The policy of an exported folder, whose self-test it has passed.

    Raises:
        SwingupError: a file is missing or damaged, or an answer differs.
    """
    policy = read_task_policy(folder / "policy.safetensors")
    with naming(f"policy in {folder}"):
        read_test(folder).check(lambda observation, _: policy.predict(observation)[0])
    return policy


def load_tested_controller(folder: Path, robot: Robot | str, guard: GuardChoice) -> LoopController[Any]:
    """The controller of an exported folder, which has passed the self-test without its guard; errors as above."""
    policy: RobotPolicy
    if (law := folder / LAW_FILE).exists():
        policy = read_feedback(law)
    else:
        policy = read_pendulum_policy(folder / "policy.safetensors", robot)
    test, alone = read_test(folder), policy_controller(replace(policy, guard=None))

    def answer(x: np.ndarray, call: int) -> np.ndarray:
        if call == 0:
            alone.reset()
        return alone(x, test.period * call)

    with naming(f"policy in {folder}"):
        test.check(answer)
    return policy_controller(policy, guard)


def read_test(folder: Path) -> SelfTest:
    """The self-test of an exported folder."""
    path = folder / FILE
    try:
        found = json.loads(read_bytes(path, MAX_BYTES))
        arrays: dict[str, Any] = {
            name: np.array(found.pop(name)) for name in ("observations", "actions", "tolerance")
        }
        test = SelfTest(**arrays, **found)
        if not len(test.observations) == len(test.actions) > 0 or not test.calls >= 1 or not test.period > 0:
            raise ValueError
        if not all(array.dtype.kind in "biuf" for array in arrays.values()):
            raise TypeError
        np.broadcast_shapes(test.actions.shape[1:], test.tolerance.shape)
        return test
    except MALFORMED as error:
        raise SwingupError(f"{path} is not a self-test: export the policy again") from error
