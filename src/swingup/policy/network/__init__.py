"""A policy's network: its arrays, the stages of its observation, and the same network folded for one plant."""

from .layers import SUM_GROUP as SUM_GROUP
from .layers import Activation as Activation
