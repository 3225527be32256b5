"""Seeds of a judgement: how many, and which."""

from ..common.checks import whole_number

LARGEST_SEED = 2**31 - 1
"""Noise keys hold a seed in 32 bits."""
MOST_SEEDS = 9999
"""Upper limit on seeds, to catch typing errors."""


def check_seeds(seed: int, seeds: int) -> range:
    """The seeds in a row that start with ``seed``."""
    first = whole_number("seed", seed, 0, LARGEST_SEED)
    return range(first, first + whole_number("seeds", seeds, 1, MOST_SEEDS))
