"""How far from upright a motor can bring a pendulum back, which no controller exceeds.

The pendulum, linearised upright, has two unstable modes. A left eigenvector w of each gives a coordinate ψ = w e of
the error e, with ψ̇ = λ ψ + (w b) u. The motor brings ψ back only from |ψ| < |w b| u_max / λ. In a mode with a still
elbow both links fall as one, and the acrobot's torque does no work: w b is 0. That mode exists where
p (A - B + p l1) = k (B + p l1), with k = m1 r1 + m2 l1, p = m2 r2 and the inertias A and B of shoulder and elbow
(``plant/base_parameters.py``), without rotors. Acrobots near it hold upright in theory only. The pendubot has no
such mode: a shoulder at rest does not stay there while the elbow falls.
"""

import dataclasses

import numpy as np

from swingup.controllers.baselines.upright import linearised
from swingup.dynamics.dynamics import UPRIGHT
from swingup.plant.plant import Plant, Robot


def holding_range(parameters: Plant, robot: Robot) -> float:
    """Largest error of the mode with the least range that the motor can bring back (rad, as an error of q1).

    Args:
        parameters: the plant; its friction is left out.
        robot: which joint is driven.
    """
    plant = dataclasses.replace(parameters, b1=0.0, b2=0.0, cf1=0.0, cf2=0.0)
    (A,), (B,), _ = linearised(plant, robot, UPRIGHT[None], np.zeros(1))
    rates, modes = np.linalg.eig(A.T)
    # Without friction the eigenvalues come in real pairs ±λ.
    unstable = rates.real > 0
    scaled = modes[:, unstable].real / modes[0, unstable].real
    most = float(parameters.limit(robot.joint))
    return float(np.min(np.abs(B @ scaled) * most / rates[unstable].real, initial=np.inf))
