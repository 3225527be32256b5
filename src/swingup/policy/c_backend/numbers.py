"""Numbers as C has them."""

import numpy as np


def braces(values: np.ndarray, suffix: str = "") -> str:
    """An initialiser; decimals that C reads back as the same numbers."""
    return "{" + ", ".join(f"{np.format_float_scientific(value)}{suffix}" for value in values) + "}"
