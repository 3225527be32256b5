"""Sweeps: many training runs over seeds and settings, on any ``concurrent.futures.Executor``.

Each run has its own folder and is a run like any other: one that is finished is not repeated, one that was cut off
resumes from its checkpoint, wherever it is started next. Workers on other machines need the same file system.
"""
