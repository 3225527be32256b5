"""The regulator that takes over from a policy near the top: ``core`` has its equations, ``settings`` its bounds."""
