"""What a controller is: in JAX, in plain Python, and whether an object is one."""
