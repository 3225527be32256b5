"""The command ``export``: a policy for other programs, or the swing-up that a baseline follows."""

import dataclasses
from collections.abc import Mapping
from typing import Annotated, Any

from tyro.conf import Positional, arg

from ..benchmark.seeds import check_seeds
from ..common.checks import one_of
from ..common.errors import SwingupError
from ..common.files import check_writable, write_atomically
from ..common.text import command_line
from ..controllers.baselines.baselines import BASELINES, DESIGN_SEED, design_of, shipped_reference
from ..controllers.baselines.own_units import in_real_units
from ..controllers.swingups.reference import save_reference
from ..controllers.swingups.trajectory_csv import save_reference_csv
from ..export.c_backend.header import c_header
from ..export.folder import FORMS as FOLDERS
from ..export.folder import NAME, cloudpendulum_guard, cloudpendulum_notes, export_folder
from ..export.onnx_backend.graph import onnx_model
from ..plant.robots import Robot
from ..policy.guard.settings import GUARD, GuardSettings, choose_guard
from ..policy.pendulum import PendulumPolicy
from ..policy.plant_facts import write_plant
from ..policy.shipped import DEFAULT, SHIPPED_POLICIES, load_policy
from .arguments import NO_OPTIONS, OptionalRobot, PlantOptions, plant_of, word_of
from .output import tell

TRAJECTORY = "trajectory"
FORMS = (*FOLDERS, "onnx", "c", TRAJECTORY)
FOLLOWED = {"tvlqr": "published", "ilqr-riccati": "published", "ilqr-mpc": "published", "tvlqr-score": "score"}
"""The problem whose swing-up a baseline follows."""

Policy = Positional[
    Annotated[
        str,
        arg(
            metavar="POLICY",
            help=f"{', '.join(SHIPPED_POLICIES)}, a policy file (.safetensors), or for trajectory a baseline: "
            f"{', '.join(FOLLOWED)}.",
        ),
    ]
]


def export_command(
    policy: Policy = DEFAULT,
    /,
    *,
    to: Annotated[str, word_of("format", *FORMS)],
    out: Annotated[str, arg(metavar="PATH")],
    robot: OptionalRobot = None,
    username: str = "swingup",
    name: str = NAME,
    guard: bool = True,
    velocity_limit: float | None = None,
    braking: float | None = None,
    plant: PlantOptions = NO_OPTIONS,
    seed: int | None = None,
) -> int:
    """Write a policy for RealAIGym, CloudPendulum, ONNX Runtime or C, or the swing-up that a baseline follows.

    Baselines have no policy file; RealAIGymController runs them.

    Args:
        policy: the policy.
        to: realaigym or cloudpendulum, a folder that needs NumPy alone; onnx, a graph of the policy's network
            alone; c, a C99 header; or trajectory, a baseline's swing-up with its gains, in RealAIGym's format where
            the file ends in .csv.
        out: the folder, new or empty; or the file.
        robot: acrobot or pendubot. Required for shipped policies; a file must match it.
        username: your name on RealAIGym's leaderboard.
        name: of the entry (con_NAME.py, controller_NAME.py), and what all names in a C header begin with, so that
            several go side by side; ONNX has none.
        guard: put a safety guard around the controller in the folders and in c: it stops the controller at a limit
            or a broken measurement. Turn it off for simulations. An onnx graph has none.
        velocity_limit: of both joints (rad/s), beyond which the guard stops the controller; by default the policy
            file's, or 20, and 50 for cloudpendulum.
        braking: damping (N m s/rad) with which the guard brakes the driven joint of a stopped controller, where the
            measurement is sound; by default the policy file's, or none.
        plant: what adaptive begins with, in that plant's units, where that is within what it was taught; or what a
            trajectory swings up: for another plant than the leaderboards' it is computed, in minutes.
        seed: compute the trajectory, shipped or not, from first torques of this seed.
    """
    if to == TRAJECTORY:
        return _export_trajectory(policy, robot, out, plant, seed)
    if seed is not None:
        raise SwingupError("--seed goes with --to trajectory: leave it out")
    if policy in BASELINES:
        raise SwingupError(
            f"{policy!r} is a baseline, which has no policy file: swingup.RealAIGymController runs it, and "
            f"--to trajectory writes its swing-up with gains"
        )
    found = load_policy(policy, robot, plant_of(plant) if plant else None)
    changes = {"velocity_limit": velocity_limit, "braking": braking}
    found = dataclasses.replace(found, guard=_guard(found, to, guard, changes))
    if to in FOLDERS:
        notes = cloudpendulum_notes(found) if to == "cloudpendulum" else []
        tell(str(export_folder(found, out, to, name, username)), *notes)
        return 0
    write_atomically(out, onnx_model(found) if to == "onnx" else c_header(found, name).encode())
    tell(out)
    if to == "onnx":
        left_out = [part for part in found.parts if part != GUARD]
        missing = f"{', '.join(left_out)} and a safety guard" if left_out else "a safety guard"
        tell(f"this is the network for the plant {found.plant.name} alone, without {missing}")
    return 0


def _export_trajectory(name: str, robot: Robot | None, out: str, plant: PlantOptions, seed: int | None) -> int:
    """Write the swing-up that a baseline follows: the shipped one, or one that iterative LQR computes."""
    problem = FOLLOWED[one_of("baseline that follows a swing-up", name, FOLLOWED)]
    if robot is None:
        raise SwingupError("--to trajectory needs a robot: add --robot acrobot or --robot pendubot")
    on = plant_of(plant)
    design = design_of(robot, on)
    check_seeds(seed or 0, 1)
    check_writable(out)
    if design.shipped and seed is None:
        reference, provenance = shipped_reference(robot, problem)
    else:
        seed = DESIGN_SEED if seed is None else seed
        reference, provenance = design.compute(problem, seed)
        reference = reference if design.shipped else in_real_units(reference, design.scales)
        command = command_line("export", name, robot=robot.name, to=TRAJECTORY, **plant, seed=seed, out=out)
        provenance |= {"plant": write_plant(on.driven(robot)), "command": command}
    if out.endswith(".csv"):
        save_reference_csv(out, reference)
    else:
        save_reference(out, reference, provenance)
    tell(out, *(f"{name:<20}{value}" for name, value in (provenance | on.summary(robot)).items()))
    return 0


def _guard(
    policy: PendulumPolicy, to: str, wanted: bool, changes: Mapping[str, float | None]
) -> GuardSettings | None:
    """The policy file's guard, or that of the robot that a form is for, with what the user changed of it."""
    own = policy.guard
    if own is None and to == "cloudpendulum":
        own = cloudpendulum_guard(policy.period)
    guard = None if to == "onnx" else choose_guard(wanted, own, policy.period)
    given: dict[str, Any] = {name: value for name, value in changes.items() if value is not None}
    if given and guard is None:
        flag = next(iter(given)).replace("_", "-")
        raise SwingupError(f"--{flag} is a setting of the safety guard: leave --no-guard out; onnx has no guard")
    return guard and dataclasses.replace(guard, **given)
