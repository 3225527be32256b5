"""Policies without JAX: a policy file's controller by NumPy and the standard library alone.

    controller = load_controller("refined", "acrobot")
    u = controller(x, t)  # [u1, u2] in N m, at every step of the loop

Import takes what NumPy's takes and a few milliseconds.
"""

from .policy.numpy_backend.controller import NumpyController as NumpyController
from .policy.numpy_backend.controller import load_controller as load_controller
