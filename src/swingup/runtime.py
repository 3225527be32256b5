"""Policies without JAX: a policy file's controller by NumPy and the standard library alone.

    controller = load_controller("adaptive", "acrobot")
    u = controller(x, t)  # [u1, u2] in N m, at every step of the loop

Policies of other tasks act by ``predict``:

    policy = load_policy("best.safetensors")
    action, _ = policy.predict(observation)

The import takes a few milliseconds more than NumPy's.
"""

# A name imported as itself is public to type checkers.
from .policy.numpy_backend import load_controller as load_controller
from .policy.numpy_backend import numpy_controller as numpy_controller
from .policy.policy import Policy as Policy
from .policy.shipped import load_policy as load_policy
