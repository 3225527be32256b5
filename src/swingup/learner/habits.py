"""What users of Stable-Baselines3 write: it has the meaning that they know, or one line says what to write here."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import jax

from ..common.checks import one_of, suggestion
from ..common.errors import SwingupError
from ..common.text import quoted

POLICIES = ("MlpPolicy", "CnnPolicy", "MultiInputPolicy", "MlpLstmPolicy", "CnnLstmPolicy")
LOG_NAME = "AREAPO"
"""Runs below ``tensorboard_log`` are AREAPO_1, AREAPO_2 and so on."""

OF_LEARN = {
    "log_interval": "reports come every evaluate_every frames, an argument of AREAPO",
    "tb_log_name": "the run's folder has the name: folder is an argument of AREAPO",
    "reset_num_timesteps": "learn always goes on from where it stands: leave it out",
}
"""Arguments of Stable-Baselines3's ``learn`` that are none here."""

DEVICES = {"auto": "", "cpu": "cpu", "cuda": "gpu", "gpu": "gpu", "tpu": "tpu"}
"""JAX's names of the devices."""


def check_env(env: Any) -> None:
    """Refuse a missing environment, or a policy's name in its place.

    Raises:
        SwingupError: it is one of the two.
    """
    if env is None:
        raise SwingupError("env is missing: name a Gymnasium id, as in AREAPO('Pendulum-v1')")
    if isinstance(env, str) and env in POLICIES:
        raise SwingupError(
            f"{quoted(env)} is no environment, which comes first: write AREAPO(env, policy_layers=(64, 64)) "
            f"instead of AREAPO({quoted(env)}, env)"
        )


def check_names(given: dict[str, Any]) -> None:
    """Refuse a policy, what describes its networks, and the length of a run, with what to write.

    Raises:
        SwingupError: they are among the keywords.
    """
    for name in given.keys() & {"frames", "total_timesteps"}:
        raise SwingupError(f"{name} = {quoted(given[name])}: give it to learn, as in AREAPO(env).learn(100_000)")
    if "policy" in given:
        raise SwingupError(f"policy = {quoted(given['policy'])}: leave it out, and write policy_layers=(64, 64)")
    layers = _layers(given.get("policy_kwargs"))
    if layers is not None:
        policy, values = layers
        raise SwingupError(
            f"policy_kwargs = {quoted(given['policy_kwargs'])}: write policy_layers={policy}, value_layers={values}"
        )


def _layers(policy_kwargs: Any) -> tuple[tuple[Any, ...], tuple[Any, ...]] | None:
    """Widths of the policy's and the values' networks, where nothing but them was said."""
    if not isinstance(policy_kwargs, dict) or set(policy_kwargs) != {"net_arch"}:
        return None
    widths = policy_kwargs["net_arch"]
    both = (widths.get("pi"), widths.get("vf")) if isinstance(widths, dict) else (widths, widths)
    policy, values = (tuple(each) if isinstance(each, list | tuple) and each else None for each in both)
    return None if policy is None or values is None else (policy, values)


def check_device(device: Any) -> None:
    """Refuse a device on which JAX does not run; it is chosen before Python starts.

    Raises:
        SwingupError: there is no such device, or JAX runs on another.
    """
    # PyTorch's devices have a text such as cuda:0.
    kind, _, number = str(device).partition(":")
    wanted, found = DEVICES[one_of("device", kind, DEVICES)], jax.default_backend()
    if number not in ("", "0"):
        raise SwingupError(f"device = {quoted(str(device))}: choose one by CUDA_VISIBLE_DEVICES={number}")
    if wanted in ("", found):
        return
    cure = "set JAX_PLATFORMS=cpu" if wanted == "cpu" else "install swingup with JAX for it, as 'swingup[cuda]',"
    raise SwingupError(
        f"device = {quoted(str(device))}, but JAX runs on {found}: {cure} before Python starts, or leave it out"
    )


def chosen_folder(folder: str | Path | None, tensorboard_log: str | Path | None) -> str | Path | None:
    """The folder of a run; below ``tensorboard_log`` a new one.

    Raises:
        SwingupError: both are given.
    """
    if tensorboard_log is None:
        return folder
    if folder is not None:
        raise SwingupError(
            f"folder = {quoted(str(folder))} has TensorBoard's events as well: leave tensorboard_log out"
        )
    number = 1
    while (place := Path(tensorboard_log) / f"{LOG_NAME}_{number}").exists():
        number += 1
    return place


def frames_to_learn(frames: int | None, total_timesteps: int | None, others: dict[str, Any]) -> int:
    """The frames of a call of ``learn``, by either of their names.

    Raises:
        SwingupError: they are missing or given twice, or another argument is unknown.
    """
    for name in others:
        known = OF_LEARN.get(name)
        near = (
            f": {known}" if known else suggestion(name, ("frames", "callback", "total_timesteps", "progress_bar"))
        )
        raise SwingupError(f"learn has no argument {quoted(name)}{near}")
    if (frames is None) == (total_timesteps is None):
        what = "are missing" if frames is None else "are given twice, also as total_timesteps"
        raise SwingupError(f"the frames to learn {what}: write learn(100_000)")
    return total_timesteps if frames is None else frames  # type: ignore[return-value]


def callbacks_of(callback: Any) -> list[Callable[..., Any]]:
    """One or several functions as a list.

    Raises:
        SwingupError: something else, such as an object of Stable-Baselines3, is among them.
    """
    if callback is None:
        return []
    several = list(callback) if isinstance(callback, Sequence) else [callback]
    for each in several:
        if not callable(each):
            raise SwingupError(
                f"callback = {quoted(each)}: pass a function of the learner and a report, which may return False"
            )
    return several
