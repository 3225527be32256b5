"""A policy: its file, what the file may hold, and what runs it.

``file`` reads and writes files, ``pendulum`` is what a file holds for a robot and its plant, and ``shipped`` names
the policies of this package. ``network``, ``estimator``, ``identifier``, ``regulator`` and ``guard`` hold the
settings, the state and the equations of one part each; its C lies beside it. ``contract`` says what back ends do,
and ``numpy_backend`` is the one that runs on a robot. All need NumPy alone.
"""
