"""A policy's network: its arrays, the stages of its observation, and the same network folded for one plant."""

from .layers import FLOAT32_SUM_WIDTH as FLOAT32_SUM_WIDTH
from .layers import Activation as Activation
