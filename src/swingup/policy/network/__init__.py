"""A policy's network: its arrays, the stages of its observation, and the same network folded for one plant."""

from .core import NORM_EPSILON as NORM_EPSILON
from .layers import SUM_GROUP as SUM_GROUP
from .layers import Activation as Activation
