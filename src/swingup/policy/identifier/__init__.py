"""The identifier of an estimator's plant: ``core`` has its equations, ``settings`` what it expects of plants."""
