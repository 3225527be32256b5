"""The double pendulum: parameters (SI), equations of motion, energy and integrators, in pure JAX."""
