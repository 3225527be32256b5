"""`swingup identify` beside MuJoCo's own system identification (`mujoco.sysid`), on the same windows of logs.

    python benchmarks/mujoco_sysid.py examples/logs/C1-excitation-1.csv examples/logs/C1-excitation-2.csv \
        --test examples/logs/C1-excitation-3.csv

Needs `pip install "mujoco[sysid]"`. Both start from the same plant, and see the same windows of 0.25 s from the
same smoothed states. MuJoCo's torques are shifted by `--delay`, which is not fitted there.
"""

import argparse
import importlib
import inspect
import time
from pathlib import Path
from typing import Any

import numpy as np

import swingup
from swingup.identification.recording import Recording, read_recording
from swingup.identification.scoring import error_row, score_windows
from swingup.identification.segments import FIT_LENGTH, INTERVAL, Segments, cut_windows, join, smooth
from swingup.plant.plant import Plant

# None of them has types.
mujoco, rollout, sysid = (importlib.import_module(name) for name in ("mujoco", "mujoco.rollout", "mujoco.sysid"))

STEP = 0.001
"""Of MuJoCo's integration (s)."""
OUTPUTS = round(FIT_LENGTH / STEP)

XML = """
<mujoco>
  <option timestep="{step}" integrator="implicitfast" gravity="0 0 -{g}"><flag contact="disable"/></option>
  <worldbody>
    <body name="link1">
      <joint name="q1" axis="0 1 0"/>
      <inertial pos="0 0 -{r1}" mass="{m1}" diaginertia="{c1} {c1} {c1}"/>
      <body name="link2" pos="0 0 -{l1}">
        <joint name="q2" axis="0 1 0"/>
        <inertial pos="0 0 -{r2}" mass="{m2}" diaginertia="{c2} {c2} {c2}"/>
      </body>
    </body>
  </worldbody>
  <actuator><motor name="u1" joint="q1"/><motor name="u2" joint="q2"/></actuator>
  <sensor>
    <jointpos name="p1" joint="q1"/><jointpos name="p2" joint="q2"/>
    <jointvel name="v1" joint="q1"/><jointvel name="v2" joint="q2"/>
  </sensor>
</mujoco>
"""


def model_of(p: Plant) -> Any:
    """MuJoCo's model of a plant; its inertias are about the centres of mass."""
    numbers = {name: float(getattr(p, name)) for name in ("m1", "m2", "r1", "r2", "l1", "g")}
    about = {"c1": float(p.I1 - p.m1 * p.r1**2), "c2": float(p.I2 - p.m2 * p.r2**2)}
    return mujoco.MjSpec.from_string(
        XML.format(step=STEP, **numbers, **{k: max(c, 1e-6) for k, c in about.items()})
    )


def parameters_of(p: Plant) -> Any:
    """What is fitted: centres and inertias of both links, and damping, dry friction and armature of both joints."""
    params = sysid.ParameterDict()

    def add(name: str, value: float, low: float, high: float, modifier: Any) -> None:
        params.add(sysid.Parameter(name, value, low, high, modifier=modifier))

    for k in (1, 2):
        link, joint, place = f"link{k}", f"q{k}", float(getattr(p, f"r{k}"))
        inertia = max(float(getattr(p, f"I{k}") - getattr(p, f"m{k}") * place**2), 1e-4)
        add(
            f"r{k}",
            place,
            0.2 * place,
            3 * place,
            lambda s, v, link=link: setattr(s.body(link), "ipos", [0, 0, -v.value[0]]),
        )
        add(
            f"I{k}",
            inertia,
            1e-6,
            10 * inertia,
            lambda s, v, link=link: setattr(s.body(link), "inertia", [v.value[0]] * 3),
        )
        # MuJoCo's joints have vectors of damping.
        add(
            f"b{k}",
            float(getattr(p, f"b{k}")),
            0.0,
            0.2,
            lambda s, v, joint=joint: setattr(s.joint(joint), "damping", [v.value[0], 0, 0]),
        )
        add(
            f"f{k}",
            1.57 * float(getattr(p, f"cf{k}")),
            0.0,
            1.0,
            lambda s, v, joint=joint: setattr(s.joint(joint), "frictionloss", v.value[0]),
        )
        add(
            f"a{k}",
            float(p.gr**2 * p.Ir),
            0.0,
            0.02,
            lambda s, v, joint=joint: setattr(s.joint(joint), "armature", v.value[0]),
        )
    return params  # fmt: skip


def sequences(spec: Any, recordings: list[Recording], windows: Segments, delay: float) -> tuple[Any, ...]:
    """Initial states, torques and smoothed states of windows, as MuJoCo's toolbox takes them."""
    model = spec.compile()
    states, controls, sensors = [], [], []
    grid = STEP * np.arange(OUTPUTS + 1)
    for log, start in zip(windows.log, windows.start, strict=True):
        recording = recordings[log]
        seen = smooth(recording, start + grid)
        held = np.searchsorted(recording.time, start + grid - delay, "right") - 1
        states.append(sysid.create_initial_state(model, seen[0, :2], seen[0, 2:]))
        controls.append(sysid.TimeSeries(grid, recording.u[held]))
        sensors.append(sysid.TimeSeries.from_names(grid, seen, model))
    return [f"w{k}" for k in range(len(states))], states, controls, sensors


def fit_with_mujoco(p: Plant, recordings: list[Recording], windows: Segments, delay: float) -> Any:
    """The fitted parameters."""
    spec, params = model_of(p), parameters_of(p)
    given = sysid.ModelSequences("pendulum", spec, *sequences(spec, recordings, windows, delay))
    residual = sysid.build_residual_fn(models_sequences=[given])
    return sysid.optimize(initial_params=params, residual_fn=residual, optimizer="mujoco", verbose=False)[0]


def held_out_error(p: Plant, params: Any, recordings: list[Recording], windows: Segments, delay: float) -> float:
    """Root mean square of the angles' errors after 0.25 s in MuJoCo's simulation (rad)."""
    spec = model_of(p)
    _, states, controls, _ = sequences(spec, recordings, windows, delay)
    model = sysid.apply_param_modifiers(params, spec)
    data = mujoco.MjData(model)
    torques = np.stack([each.data[:-1] for each in controls])
    found = np.asarray(rollout.rollout(model, data, np.stack(states), torques)[0])
    last = found[:, OUTPUTS - 1, 1:5]  # after the time
    return error_row(last - windows.states[:, round(FIT_LENGTH / INTERVAL)]).angle or 0.0


def main() -> None:
    """Fit both and print the comparison."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("logs", nargs="+", type=Path)
    parser.add_argument("--test", nargs="+", type=Path, required=True)
    parser.add_argument("--start", default="C.1")
    parser.add_argument("--delay", type=float, default=0.004, help="shift of MuJoCo's torques (s)")
    given = parser.parse_args()
    plant = swingup.load_plant(given.start)
    recordings, tests = ([read_recording(log) for log in logs] for logs in (given.logs, given.test))
    windows = join([cut_windows(each, FIT_LENGTH, log=log) for log, each in enumerate(recordings)])
    begun = time.monotonic()
    found = swingup.identify(given.logs, test=given.test, start=given.start)
    seconds, errors = time.monotonic() - begun, found.errors
    print(f"start:        {errors['start']['0.25'].angle:.4f} rad after 0.25 s of held-out motion")
    print(f"swingup:      {errors['fitted']['0.25'].angle:.4f} rad, {seconds:.0f} s, 1 line of code")
    begun = time.monotonic()
    params = fit_with_mujoco(plant, recordings, windows, given.delay)
    seconds = time.monotonic() - begun
    error = held_out_error(plant, params, tests, score_windows(tests), given.delay)
    parts = (model_of, parameters_of, sequences, fit_with_mujoco)
    lines = sum(len(inspect.getsource(part).splitlines()) for part in parts) + len(XML.splitlines())
    print(f"mujoco.sysid: {error:.4f} rad, {seconds:.0f} s, {lines} lines of code")


if __name__ == "__main__":
    main()
