"""Sweeps: many training runs over seeds and settings, on any ``concurrent.futures.Executor``.

Each run has its own folder, like any other run. A finished run is not repeated. An interrupted one resumes from its
checkpoint, on whatever worker it is started next. Workers on other machines need the same file system.
"""
