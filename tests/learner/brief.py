"""Runs whose policies are judged by swing-ups of half a second, for tests of anything but the judging.

Policies that were hardly trained score nothing in ten seconds either; whole swing-ups are judged where commands
train (``cli/test_training.py``) and where processes are killed (``test_faults.py``).
"""

import contextlib
import dataclasses

import pytest

from swingup.benchmark.boards import BOARDS


@contextlib.contextmanager
def briefly_judged():
    """Rules v2 of the performance board with 250 steps."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(BOARDS, "performance", dataclasses.replace(BOARDS["performance"], duration=0.5))
        yield
