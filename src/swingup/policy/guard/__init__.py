"""The safety guard between a loop and a controller: ``core`` has its steps, ``settings`` its limits and reasons."""
