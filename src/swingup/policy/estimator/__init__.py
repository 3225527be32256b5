"""The state estimator before a policy: ``core`` has its equations, ``settings`` what a file may say of it."""
