"""The continuing MuJoCo tasks of Wan, Korenkevych and Zhu (arXiv 2501.06937) as Gymnasium environments.

Importing this module registers ``swingup/ContinuingSwimmer-v0`` and its like; they need the extra ``mujoco``. A
continuing task is one endless stream: it neither terminates nor truncates. Where a body falls it is put back on its
feet at a cost, and the next observation is that of the reset. Rewards and models are those of Gymnasium's v4, in
which the paper has its tables, but for Pusher, whose v4 does not run with MuJoCo 3 and later.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, cast, get_args

import gymnasium
import numpy as np
from gymnasium.spaces import Box
from jaxtyping import Float

from .common.checks import finite_number, one_of
from .common.errors import SwingupError

Resets = Literal["predefined", "chosen"]
Vector = Float[np.ndarray, "n"]


@dataclass(frozen=True)
class ContinuingTask:
    """What a continuing task changes in a task of Gymnasium's."""

    base: str  # Gymnasium's id
    arguments: Mapping[str, Any] = field(default_factory=dict)  # What the base task is made with
    resets: bool = False  # Whether the task has resets: predefined ones, or chosen by the policy
    last_reward: float = 0.0  # What v4 pays for health in the step of a fall, and v5 does not
    pays_before: bool = False  # Whether v4's reward is of the state before the step, where v5's is of the one after
    fell: Callable[[Any], bool] = lambda env: False
    """Whether the body fell, where the base task does not say so."""
    prepare: Callable[[Any], None] = lambda env: None  # Changes the base task's model
    observe: Callable[[Vector], Vector] = lambda observation: observation  # Changes observations
    move_every: int = 0  # Steps after which move places something anew; 0: never
    move: Callable[[Any, np.random.Generator], None] = lambda env, draws: None


def _wrap_angles(observation: Vector) -> Vector:
    """The swimmer's three angles in [-π, π)."""
    angles = (observation[:3] + np.pi) % (2 * np.pi) - np.pi
    return np.concatenate([angles, observation[3:]])


def _widen_joints(env: Any) -> None:
    """Ankles that bend both ways: an ant on its back can get up again."""
    for joint in (1, 2, 3, 4):
        env.model.joint(f"ankle_{joint}").range = np.deg2rad([-70.0, 70.0])
        env.model.joint(f"hip_{joint}").range = np.deg2rad([-30.0, 30.0])


def _move_target(env: Any, draws: np.random.Generator) -> None:
    """The reacher's target somewhere within 0.2 m of its shoulder."""
    target = draws.uniform(-0.2, 0.2, 2)
    while np.linalg.norm(target) >= 0.2:
        target = draws.uniform(-0.2, 0.2, 2)
    env.set_state(np.concatenate([env.data.qpos[:2], target]), env.data.qvel.copy())


def _move_object(env: Any, draws: np.random.Generator) -> None:
    """The pusher's object at rest somewhere, more than 0.17 m from its goal."""
    place = draws.uniform([-0.3, -0.2], [0.0, 0.2])
    while np.linalg.norm(place) <= 0.17:
        place = draws.uniform([-0.3, -0.2], [0.0, 0.2])
    qpos, qvel = env.data.qpos.copy(), env.data.qvel.copy()
    qpos[-4:-2], qvel[-4:] = place, 0.0
    env.set_state(qpos, qvel)


def _lies(env: Any) -> bool:
    """Whether the cheetah's torso is below 0.15 m."""
    return bool(env.model.body("torso").pos[2] + env.data.qpos[1] < 0.15)


_ANT = {"contact_cost_weight": 0.0, "include_cfrc_ext_in_observation": False}
CONTINUING = {
    "Swimmer": ContinuingTask("Swimmer-v5", observe=_wrap_angles),
    "HumanoidStandup": ContinuingTask("HumanoidStandup-v5"),
    "Reacher": ContinuingTask("Reacher-v5", pays_before=True, move_every=50, move=_move_target),
    "Pusher": ContinuingTask("Pusher-v5", move_every=100, move=_move_object),
    "SpecialAnt": ContinuingTask("Ant-v5", {**_ANT, "terminate_when_unhealthy": False}, prepare=_widen_joints),
    "HalfCheetah": ContinuingTask("HalfCheetah-v5", resets=True, fell=_lies),
    "Ant": ContinuingTask("Ant-v5", _ANT, resets=True, last_reward=1.0),
    "Hopper": ContinuingTask("Hopper-v5", resets=True, last_reward=1.0),
    "Humanoid": ContinuingTask("Humanoid-v5", {"contact_cost_weight": 0.0}, resets=True, last_reward=5.0),
    "Walker2d": ContinuingTask("Walker2d-v5", {"xml_file": "walker2d.xml"}, resets=True, last_reward=1.0),
}  # fmt: skip
"""The ten tasks by their names."""


class ContinuingEnv(gymnasium.Env[np.ndarray, np.ndarray]):
    """A continuing task: ``terminated`` and ``truncated`` are always false."""

    own_resets: int
    """Resets so far that the task made itself, at a cost. The learner counts them by this attribute."""

    def __init__(
        self,
        task: str,
        resets: Resets = "predefined",
        reset_cost: float = 10.0,
        reward_offset: float = 0.0,
        render_mode: str | None = None,
    ) -> None:
        """Prepare an environment, to be reset before its first step.

        Args:
            task: a name of :data:`CONTINUING`.
            resets: ``predefined``: where the body falls. ``chosen``: falls have no consequence, and one more action
                in [0, 1] is the probability of a reset after the step.
            reset_cost: what a reset takes from the reward of its step.
            reward_offset: added to every reward, which an average-reward learner must not notice.
            render_mode: Gymnasium's.

        Raises:
            SwingupError: there is no such task, an argument cannot work, or the task has no resets to choose.
        """
        self._task = CONTINUING[one_of("task", task, CONTINUING)]
        self._chosen = one_of("resets", resets, get_args(Resets)) == "chosen"
        if self._chosen and not self._task.resets:
            raise SwingupError(f"{task} has no resets to choose: leave out resets")
        self._cost = finite_number("reset_cost", reset_cost)
        self._offset = finite_number("reward_offset", reward_offset)
        arguments = dict(self._task.arguments)
        if self._chosen and self._task.last_reward:
            arguments["terminate_when_unhealthy"] = False
        made = gymnasium.make(self._task.base, -1, disable_env_checker=True, render_mode=render_mode, **arguments)
        self._env = cast(Any, made.unwrapped)
        self._task.prepare(self._env)
        self.metadata, self.render_mode = self._env.metadata, render_mode
        self.observation_space, self.action_space = self._env.observation_space, self._env.action_space
        if self._chosen:
            low, high = self._env.action_space.low, self._env.action_space.high
            self.action_space = Box(np.append(low, np.float32(0)), np.append(high, np.float32(1)))
        self.own_resets, self._steps = 0, 0

    @property
    def dt(self) -> float:
        """Time of a step (s)."""
        return float(self._env.dt)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Vector, dict[str, Any]]:
        """Start the stream; a seed fixes all later draws."""
        super().reset(seed=seed)
        self._steps = 0
        observation, info = self._env.reset(seed=seed)
        return self._task.observe(observation), info

    def step(self, action: np.ndarray) -> tuple[Vector, float, bool, bool, dict[str, Any]]:
        """Gymnasium's step; ``info["reset"]`` says whether the next observation is a reset's."""
        reset = False
        if self._chosen:
            reset = bool(self.np_random.random() < action[-1])
            action = action[:-1]
        before = self._env._get_rew(action)[0] if self._task.pays_before else None
        observation, reward, fell, _, info = self._env.step(action)
        reward = reward if before is None else before
        if not self._chosen:
            reset = fell or self._task.fell(self._env)
            reward += self._task.last_reward * fell
        self._steps += 1
        if reset:
            self.own_resets += 1
            reward -= self._cost
            observation, _ = self._env.reset()
        elif self._task.move_every and self._steps % self._task.move_every == 0:
            self._task.move(self._env, self.np_random)
            observation = self._env._get_obs()
        return self._task.observe(observation), float(reward) + self._offset, False, False, {**info, "reset": reset}

    def render(self) -> Any:
        """Gymnasium's picture."""
        return self._env.render()

    def close(self) -> None:
        """Close the simulation."""
        self._env.close()


for _name, _task in CONTINUING.items():
    for _suffix, _resets in (("", "predefined"), ("ChosenResets", "chosen"))[: 1 + _task.resets]:
        gymnasium.register(
            id=f"swingup/Continuing{_name}{_suffix}-v0",
            entry_point=f"{__name__}:ContinuingEnv",
            kwargs={"task": _name, "resets": _resets},
        )
