"""The equations of motion on JAX: accelerations and integrators."""
