"""Gymnasium environments of all spaces and autoreset modes, in the one form that the learner steps.

A step returns the observation to act on next, the true next observation before any reset, and whether the row
counts. With ``SAME_STEP`` the true next observation is in ``final_obs``. ``NEXT_STEP`` spends a row on the reset;
until then the previous start, a draw of the same distribution, stands for the new one. With ``DISABLED`` the
wrapper itself resets the environments whose episode ended.

A stream is reset once in its life, whoever learns from it. Its environment says in ``info["late"]`` where a step's
action came too late: the state had moved on from the observation that it was chosen for.
"""

import contextlib
import copy
import functools
import importlib
import multiprocessing
import time
import weakref
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NoReturn

import gymnasium
import numpy as np
from gymnasium import ActionWrapper, ObservationWrapper, RewardWrapper
from gymnasium.spaces import Box, Discrete, MultiDiscrete
from gymnasium.vector import AsyncVectorEnv, AutoresetMode, SyncVectorEnv, VectorEnv
from gymnasium.wrappers import OrderEnforcing, PassiveEnvChecker, TimeLimit
from jaxtyping import Bool, Float32, Shaped

from .. import gym  # noqa: F401 (registers swingup's own ids)
from ..common.checks import whole_number
from ..common.errors import SwingupError, attribute, errors_named_after, one_line, quoted
from ..common.files import working_folder_first
from ..tasks.adapters import shape_of_observation
from ..tasks.task import AbstractTask, Spaces, space_actions
from .metrics import step_time

MAKES_SENSE = (
    "a Gymnasium id, a function that makes a gymnasium.Env, a list of such functions, a "
    "gymnasium.vector.VectorEnv, an environment of gymnax or envelope, or a task in JAX"
)

SAME_AGAIN = "returned the same environment again: make a new one in each call"

RESET = ("observations", "infos")
STEP = ("observations", "rewards", "terminated", "truncated", "infos")  # What Gymnasium's methods return
PATIENCE = 60.0  # How long the workers of an AsyncVectorEnv may take for a step or a reset (s)

LATE = "late"  # Entry of a stream's info: whether the state had moved on before this step's action came
SUCCESS = "is_success"  # Entry of a step's info by which environments with a goal say that it is reached
OWN_RESETS = "own_resets"  # Attribute of continuing tasks: the resets that they made themselves, without an end

RUNNING: dict[int, Float32[np.ndarray, "envs n"]] = {}
"""What each stream that was reset showed last, by its identity: a second learner goes on where the first left off.
An environment need not be hashable; its entry goes with it."""

OCCUPIED: set[int] = set()
"""Environments that are being trained on, by their identities."""


@dataclass(frozen=True)
class HostStep:
    """The result of a step of all environments."""

    following: Float32[np.ndarray, "envs n"]  # Observations to act on next
    true_next: Float32[np.ndarray, "envs n"]  # Observations after the step and before any reset
    rewards: Float32[np.ndarray, "envs"]
    terminated: Bool[np.ndarray, "envs"]
    truncated: Bool[np.ndarray, "envs"]
    counted: Bool[np.ndarray, "envs"]  # False where the environment did nothing but reset itself, or was late
    late: Bool[np.ndarray, "envs"]  # Whether a stream had moved on before the step
    goals: Bool[np.ndarray, "envs"]  # Ends that an environment calls a success

    @property
    def ended(self) -> Bool[np.ndarray, "envs"]:
        """Where an episode ended."""
        return self.terminated | self.truncated


class Environments:
    """Environments side by side, with flat observations in single precision."""

    def __init__(
        self, env: VectorEnv[Any, Any, Any], name: str | None = None, lent: bool = False, stream: bool = False
    ) -> None:
        """Wrap a vector environment; its owner closes one that is lent. A stream is reset once in its life."""
        name = type(env).__name__ if name is None else name
        space, actions = (attribute(env, f"single_{each}_space") for each in ("observation", "action"))
        if not isinstance(space, Box):
            raise SwingupError(
                f"observations {one_line(space, 200)} of {name} are not a Box: wrap it in "
                "gymnasium.wrappers.FlattenObservation"
            )
        shape_of_observation(space, name)
        if not isinstance(actions, Box | Discrete | MultiDiscrete):
            raise SwingupError(
                f"actions {one_line(actions, 200)} are not supported: use a bounded Box, Discrete or MultiDiscrete"
            )
        metadata = attribute(env, "metadata")
        mode = metadata.get("autoreset_mode") if isinstance(metadata, dict) else metadata
        if not isinstance(mode, AutoresetMode):
            raise SwingupError(
                f"{name} says autoreset_mode = {quoted(mode)} in its metadata: it must be an AutoresetMode"
            )
        self.observation_space, self.actions = space, space_actions(actions)
        self.spaces = Spaces(int(np.prod(space.shape)), self.actions.size, self.actions.choices)
        self.num_envs = whole_number(f"num_envs of {name}", attribute(env, "num_envs"), 1)
        # Only of environments in this process: a worker process would not survive an attribute it lacks.
        members: list[Any] = env.envs if isinstance(env, SyncVectorEnv) else []
        self.step_time = step_time(*members[:1] or [env])
        self._counting = list(filter(counts_resets, members))
        self.endless = stream or bool(self._counting)
        """Whether these are a stream or continuing tasks, which count the resets that they make themselves."""
        self.all_count = mode is not AutoresetMode.NEXT_STEP and not stream
        """Whether no row is spent on a reset, or late."""
        self.stream = stream
        sources = [each.unwrapped for each in members or [env]]
        self._source, self.identities = sources[0], set(map(id, sources))
        if not stream:
            for each in sources:
                refuse_running(each, name)
        self._env, self._mode, self._name, self._lent = env, mode, name, lent
        self.episodes: list[tuple[float, int]] = []
        """Return and length of each episode that ended since the last reset; who reads them may clear them."""
        self.successes: list[bool] = []
        """Whether it was a success, of each episode whose environment says so; likewise."""
        self.names_goals = False  # Whether an environment ever said whether an end is a success
        self.steps = 0  # So far
        self.late_steps = 0  # Of a stream, within rollouts; who reads the number may set it to 0
        self.longest_pause = 0.0  # Between an answer and the next actions (s); who reads it may set it to 0
        self._answered: float | None = None
        self._new_episodes()

    @property
    def latest(self) -> Float32[np.ndarray, "envs n"] | None:
        """What a stream showed last; None before its only reset."""
        found = RUNNING.get(id(self._source)) if self.stream else None
        if found is not None and found.shape != (wanted := (self.num_envs, self.spaces.observation_size)):
            raise SwingupError(
                f"{self._name} ran before with observations of shape {found.shape}, and has {wanted} now: pass it "
                "with the same wrappers"
            )
        return found

    @property
    def own_resets(self) -> int:
        """Resets so far that continuing tasks made themselves."""
        return sum(each.get_wrapper_attr(OWN_RESETS) for each in self._counting)

    def reset(self, seed: int) -> Float32[np.ndarray, "envs n"]:
        """Start new episodes in all environments, from a seed that fixes all later draws."""
        self._starts, self._answered = self._begin(seed=seed), None
        self._new_episodes()
        return self._starts.copy()

    def _new_episodes(self) -> None:
        self._resetting = np.zeros(self.num_envs, np.bool_)
        self._returns, self._lengths = np.zeros(self.num_envs), np.zeros(self.num_envs, np.int64)
        self.episodes.clear()
        self.successes.clear()

    def step(self, actions: Shaped[np.ndarray, "envs m"]) -> HostStep:
        """Take the policy's actions in all environments."""
        counted, each = ~self._resetting, (self.num_envs,)
        self.steps += 1
        chosen = self.actions(actions)
        if self._answered is not None:
            self.longest_pause = max(self.longest_pause, time.perf_counter() - self._answered)
        returned = self._call("step", STEP, chosen)
        self._answered = time.perf_counter()
        observations = self._observations(returned["observations"])
        rewards = self._numbers("rewards", returned["rewards"], each)
        # A row that was spent on a reset belongs to no episode: it neither ends one nor earns a reward.
        terminated, truncated = (
            self._array(end, returned[end], each, "b") & counted for end in ("terminated", "truncated")
        )
        late = np.zeros(self.num_envs, np.bool_)
        if self.stream:
            if terminated.any() or truncated.any():
                _refuse_end(self._name, bool(terminated.any()))
            told = returned["infos"]
            if isinstance(told, Mapping) and LATE in told:
                late = self._flags(LATE, told[LATE])
            counted = ~late
        following, true_next = self._around_resets(observations, terminated | truncated, returned["infos"])
        rewards = np.where(counted, rewards, np.float32(0.0))
        goals = self._goals(terminated | truncated, returned["infos"])
        step = HostStep(following, true_next, rewards, terminated, truncated, counted, late, goals)
        self._returns += step.rewards
        self._lengths += step.counted
        for index in np.flatnonzero(step.ended):
            self.episodes.append((float(self._returns[index]), int(self._lengths[index])))
            self._returns[index], self._lengths[index] = 0.0, 0
        return step

    @contextlib.contextmanager
    def occupied(self) -> Iterator[None]:
        """Nobody else may reset them."""
        OCCUPIED.update(self.identities)
        try:
            yield
        finally:
            OCCUPIED.difference_update(self.identities)

    def close(self) -> None:
        """Close the environments, unless their owner does."""
        if not self._lent:
            self._env.close()

    def _goals(self, ended: Bool[np.ndarray, "envs"], infos: Any) -> Bool[np.ndarray, "envs"]:
        """Which ends the environments call a success."""
        goals = np.zeros(self.num_envs, np.bool_)
        if not ended.any():
            return goals
        told = infos.get("final_info", infos) if isinstance(infos, Mapping) else None
        if isinstance(told, Mapping) and SUCCESS in told:
            goals = ended & self._flags(SUCCESS, told[SUCCESS])
            self.names_goals = True
        # An environment may say it of successes alone.
        self.successes += goals[ended].tolist()
        return goals

    def _around_resets(
        self, seen: Float32[np.ndarray, "envs n"], ended: Bool[np.ndarray, "envs"], infos: Any
    ) -> tuple[Float32[np.ndarray, "envs n"], Float32[np.ndarray, "envs n"]]:
        """The observations to act on next and the true next ones, from those that a step returned."""
        if self._mode is AutoresetMode.NEXT_STEP and not self.stream:
            self._starts[self._resetting] = seen[self._resetting]
            self._resetting = ended
        if not ended.any():
            return seen, seen
        # Each mode returns one of the two observations; the other differs only where an episode ended.
        other = seen.copy()
        if self._mode is AutoresetMode.NEXT_STEP:
            other[ended] = self._starts[ended]
            return other, seen
        if self._mode is AutoresetMode.DISABLED:
            # Gymnasium's option for vector environments that do not reset themselves.
            other[ended] = self._begin(options={"reset_mask": ended})[ended]
            return other, seen
        for index in np.flatnonzero(ended).tolist():
            final = infos.get("final_obs") if isinstance(infos, Mapping) else None
            last = final[index] if isinstance(final, np.ndarray | list | tuple) and index < len(final) else None
            other[index] = self._numbers(f"final_obs[{index}]", last, self.observation_space.shape).ravel()
        return seen, other

    def _begin(self, **arguments: Any) -> Float32[np.ndarray, "envs n"]:
        return self._observations(self._call("reset", RESET, **arguments)["observations"])

    def _call(self, method: str, names: tuple[str, ...], *arguments: Any, **options: Any) -> dict[str, Any]:
        """Call a method of the environment; what it returns, by name."""
        never = "" if method == "step" or self.stream else ", or pass resets='never' if it cannot be reset again"
        with errors_named_after(f"{method}() of {self._name}", f"correct it there{never}"):
            if type(self._env) is AsyncVectorEnv:
                returned = _wait_for(self._env, method, *arguments, **options)
            else:
                returned = getattr(self._env, method)(*arguments, **options)
        if not isinstance(returned, tuple) or len(returned) != len(names):
            raise SwingupError(f"{method}() of {self._name} gave {quoted(returned)}: return ({', '.join(names)})")
        return dict(zip(names, returned, strict=True))

    def _observations(self, value: Any) -> Float32[np.ndarray, "envs n"]:
        shape = (self.num_envs, *self.observation_space.shape)
        found = self._numbers("observations", value, shape).reshape(self.num_envs, -1)
        if self.stream:
            if id(self._source) not in RUNNING:
                weakref.finalize(self._source, RUNNING.pop, id(self._source), None)
            RUNNING[id(self._source)] = found
        return found

    def _numbers(self, what: str, value: Any, shape: tuple[int, ...]) -> Float32[np.ndarray, "..."]:
        array = self._array(what, value, shape, "fiub")
        with np.errstate(over="ignore"):  # an overflow is an infinity, which is refused below
            # Also a copy: environments may use their buffers again.
            single = array.astype(np.float32)
        if not np.isfinite(single).all():
            first = tuple(np.argwhere(~np.isfinite(single))[0].tolist())
            which = f" by environment {first[0]}" if shape[:1] == (self.num_envs,) else ""
            raise SwingupError(
                f"{self._name} gave {what} that are not finite, {array[first]}{which} in step {self.steps}: "
                "correct it there"
            )
        return single

    def _flags(self, name: str, value: Any) -> Bool[np.ndarray, "envs"]:
        """An entry of infos for each environment, which Gymnasium keeps as objects where it is one of NumPy's."""
        if isinstance(value, np.ndarray) and value.dtype == object:
            value = np.array([False if each is None else each for each in value])
        return self._array(name, value, (self.num_envs,), "biuf") != 0

    def _array(self, what: str, value: Any, shape: tuple[int, ...], kinds: str) -> np.ndarray:
        """An array of a shape and of NumPy's kinds.

        NumPy would broadcast a reward of the wrong length, turn a text into a number, and take any number that is
        not 0 for an end: training would continue with values that no environment meant.
        """
        try:
            array = np.asarray(value)
        except Exception:  # ragged lists, and what a foreign __array__ raises
            array = None
        if array is None or array.dtype.kind not in kinds or array.shape != shape:
            wanted = f"{'booleans' if kinds == 'b' else 'numbers'} of shape {shape}"
            kind = type(value).__name__ if array is None else f"{array.dtype} of shape {array.shape}"
            raise SwingupError(f"{self._name} gave {what} {quoted(value)}, {kind}: return {wanted}")
        return array


def make_environments(env: Any, num_envs: int, stream: bool = False) -> Environments:
    """Environments from an id, from one that was made or a function that makes it, or from a vector environment."""
    own, name = own_number(env, stream), one_line(env, 200)
    if own not in (None, num_envs):
        raise SwingupError(
            f"num_envs = {num_envs}, but env holds {own}: make them equal, or pass the function that makes one, as "
            "in AREAPO(lambda: MyEnv(...))"
        )
    if isinstance(env, VectorEnv):
        return Environments(_checked_vector(env, stream), lent=True, stream=stream)
    found = _makers(env, stream)
    makers = [found] * num_envs if callable(found) else found
    with errors_named_after(f"making {num_envs} of {quoted(env, 200)}", f"use {MAKES_SENSE}"):
        # SAME_STEP spends no row on a reset; a stream is not to be reset by itself, either.
        mode = AutoresetMode.DISABLED if stream else AutoresetMode.SAME_STEP
        several = SyncVectorEnv([functools.partial(_one, make, stream) for make in makers], autoreset_mode=mode)
    lent, held = isinstance(env, gymnasium.Env) and own is not None, {id(each.unwrapped) for each in several.envs}
    try:
        if len(held) < num_envs:
            raise SwingupError(f"{name} {SAME_AGAIN}")
        return Environments(several, name, lent, stream)
    except SwingupError:
        # The caller never sees new environments and cannot close them; others are somebody's.
        if not lent and len(held) == num_envs and not held & (OCCUPIED | RUNNING.keys()):
            several.close()
        raise


def counts_resets(env: Any) -> bool:
    """Whether an environment counts its own resets, as continuing tasks do; a function that makes it is not run."""
    members = env.envs if isinstance(env, SyncVectorEnv) else [env]
    return any(isinstance(each, gymnasium.Env) and each.has_wrapper_attr(OWN_RESETS) for each in members)


def own_number(env: Any, stream: bool = False) -> int | None:
    """The number of environments that were passed in; None where there is something to make any number from."""
    if isinstance(env, VectorEnv):
        return int(env.num_envs)
    makers = _makers(env, stream)
    return None if callable(makers) else len(makers)


def _makers(env: Any, stream: bool) -> Sequence[Callable[[], Any]] | Callable[[], Any]:
    """What makes each environment of a list, or the one that was passed in; else what makes any number of them.

    What ``gymnasium.make`` made does not count as passed in, except as a stream: its record makes more of it, with
    all its wrappers.
    """
    if isinstance(env, list | tuple) and env and all(map(callable, env)):
        return env
    if isinstance(env, gymnasium.Env):
        spec = attribute(env, "spec")
        # A wrapper that records no arguments has None here.
        if stream or spec is None or any(wrapper.kwargs is None for wrapper in spec.additional_wrappers):
            return [lambda: env]
        _refuse_outer_limit(env)
        # One window is for people; eight of them and five for the evaluation are not.
        window = {"render_mode": None} if spec.kwargs.get("render_mode") == "human" else {}
        return functools.partial(gymnasium.make, spec, **window)
    if isinstance(env, str):
        return functools.partial(make_by_id, env, **({"max_episode_steps": -1} if stream else {}))
    if callable(env):
        return env
    raise SwingupError(f"{type(env).__name__} {one_line(env, 200)} cannot be trained on: use {MAKES_SENSE}")


def _refuse_outer_limit(env: Any) -> None:
    """Refuse a time limit around a wrapper that may count other steps, or a shorter limit: copies differ."""
    outermost: Any = None
    # Down to the wrappers that gymnasium.make puts around every environment.
    while isinstance(env, gymnasium.Wrapper) and not isinstance(env, PassiveEnvChecker | OrderEnforcing):
        limit = env._max_episode_steps if isinstance(env, TimeLimit) else 0
        changes_steps = not isinstance(env, ActionWrapper | ObservationWrapper | RewardWrapper)
        if outermost is not None and changes_steps and limit < outermost._max_episode_steps:
            raise SwingupError(
                f"Gymnasium's spec, by which environments are copied, puts TimeLimit inside {type(env).__name__}: "
                "pass the function that makes it, as in AREAPO(lambda: ...)"
            )
        outermost, env = (env if outermost is None and limit > 0 else outermost), env.env


def make_by_id(name: str, **options: Any) -> Any:
    """``gymnasium.make``; the module of ``module:id`` may lie in the working folder."""
    if ":" in name:
        with working_folder_first():
            importlib.import_module(name.partition(":")[0])
    return gymnasium.make(name, **options)


def refuse_running(env: Any, name: str) -> None:
    """Refuse to reset an environment that runs as a stream, or that a learner steps."""
    if id(env) in OCCUPIED:
        raise SwingupError(
            f"{name} is being trained on, and its episode would be lost: take another one, or the report's score"
        )
    if id(env) in RUNNING:
        raise SwingupError(
            f"{name} runs as a stream that is never reset: take another one, or the stream's reward rate"
        )


def _refuse_end(name: str, terminated: bool) -> NoReturn:
    """Refuse the end of a stream."""
    remedy = (
        "return False, put it back within the step, and take the cost from the reward"
        if terminated
        else "make it without a limit, as gymnasium.make(..., max_episode_steps=-1)"
    )
    ended = "terminated" if terminated else "truncated"
    raise SwingupError(f"{name} {ended}, but is never to be reset: {remedy}")


def _one(make: Callable[[], Any], stream: bool) -> gymnasium.Env[Any, Any]:
    made = make()
    if not isinstance(made, gymnasium.Env):
        remedy = "pass the task itself" if isinstance(made, AbstractTask) else "it must make a gymnasium.Env"
        raise SwingupError(f"{one_line(make, 200)} made a {type(made).__name__}: {remedy}")
    return CheckedEnvironment(made, stream)


def _checked_vector(env: VectorEnv[Any, Any, Any], stream: bool) -> VectorEnv[Any, Any, Any]:
    """The vector environment, with checks of what it is made of where that is in this process."""
    _refuse_normalisers(env)
    if type(env) is not SyncVectorEnv:
        return env
    checked: Any = copy.copy(env)  # its owner's keeps its environments as they are
    checked.envs = [CheckedEnvironment(each, stream) for each in checked.envs]
    if stream:  # nor is it reset at an end that is refused
        checked.autoreset_mode = AutoresetMode.DISABLED
        checked.metadata = checked.metadata | {"autoreset_mode": AutoresetMode.DISABLED}
    return checked


def _wait_for(env: AsyncVectorEnv, method: str, *arguments: Any, **options: Any) -> Any:
    """Call a method; Gymnasium would wait without end for workers that do not answer, and once more on closing."""
    getattr(env, f"{method}_async")(*arguments, **options)
    try:
        return getattr(env, f"{method}_wait")(timeout=PATIENCE)
    except multiprocessing.TimeoutError:
        env.close(terminate=True)
        raise SwingupError(
            f"a worker of {type(env).__name__} did not answer for {PATIENCE:g} s, and all were stopped: "
            "correct the environment that hangs"
        ) from None


def _refuse_normalisers(env: Any) -> None:
    """Refuse wrappers that normalise by statistics that evaluations and policy files would lack."""
    while env is not None:
        fields = attribute(env, "__dict__", {})
        what = "observations" if "obs_rms" in fields else "rewards" if "return_rms" in fields else None
        if what is not None and attribute(env, "update_running_mean", True):
            itself = "the learner does that" if what == "observations" else "see the learner's normalise_rewards"
            raise SwingupError(
                f"{type(env).__name__} normalises {what} by statistics of its own, which an evaluation on other "
                f"environments lacks: leave it out ({itself}), or set its update_running_mean to False"
            )
        for each in fields.get("envs", ()):
            _refuse_normalisers(each)
        env = fields.get("env")


class CheckedEnvironment(gymnasium.Wrapper[Any, Any, Any, Any]):
    """An environment whose first reset and first step are checked against Gymnasium's interface.

    Gymnasium's own ``PassiveEnvChecker``, which ``gymnasium.make`` adds, only warns of a wrong form, and also of
    observations that train well. Later steps are checked together, for their shapes and for numbers that are not
    finite. Infos keep ``late``, and ``is_success`` at an end: nobody reads the rest, and to merge those of several
    costs a tenth of a step.
    """

    def __init__(self, env: gymnasium.Env[Any, Any], stream: bool = False) -> None:
        _refuse_normalisers(env)
        super().__init__(env)
        self._stream = stream
        self._checked: set[str] = set()

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """The environment's first observation, without its infos."""
        try:
            returned = self.env.reset(seed=seed, options=options)
        except TypeError as error:
            if "unexpected keyword argument" not in str(error):
                raise
            raise SwingupError(
                f"reset() of {one_line(self.env, 100)} lacks an argument ({one_line(error, 100)}): Gymnasium's is "
                "reset(*, seed=None, options=None)"
            ) from error
        if "reset" not in self._checked:
            self._check("reset", returned, "(observation, info)")
        return returned[0], {}

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """The environment's step, of whose infos only what is read is kept."""
        returned: Any = self.env.step(action)
        if "step" not in self._checked:
            self._check("step", returned, "(observation, reward, terminated, truncated, info)")
        observation, reward, terminated, truncated, info = returned
        if self._stream and (terminated or truncated):  # before a vector environment would take note of the end
            _refuse_end(one_line(self.env, 100), terminated)
        kept = {LATE: True} if isinstance(info, Mapping) and info.get(LATE) else {}
        if terminated or truncated:
            # A vector environment resets now, which may write into the same array.
            observation = copy.deepcopy(observation)
            if isinstance(info, Mapping) and SUCCESS in info:
                kept[SUCCESS] = bool(info[SUCCESS])
        return observation, reward, bool(terminated), bool(truncated), kept

    def _check(self, method: str, returned: Any, form: str) -> None:
        def require(holds: bool, what: str, value: Any, wanted: str) -> None:
            if not holds:
                of_shape = f" of shape {shape}" if (shape := getattr(value, "shape", None)) else ""
                shown = f"{method}() of {one_line(self.env, 100)} gave {what}{quoted(value)}{of_shape}"
                raise SwingupError(f"{shown}: Gymnasium's returns {wanted}")

        require(isinstance(returned, tuple) and len(returned) == form.count(",") + 1, "", returned, form)
        # Without a shape the space is not a Box, which is refused elsewhere.
        space, seen = self.observation_space.shape, returned[0]
        wanted = f"one of shape {space}, as its observation_space"
        require(space is None or np.shape(seen) == space, "the observation ", seen, wanted)
        if method == "step":
            names = ("the reward", "terminated =", "truncated =")
            for what, kinds, value in zip(names, ("fiub", "b", "b"), returned[1:4], strict=True):
                wanted = f"{form}, where this is {'True or False' if kinds == 'b' else 'a number'}"
                require(np.shape(value) == () and np.asarray(value).dtype.kind in kinds, f"{what} ", value, wanted)
        self._checked.add(method)
