"""Discrete Riccati equations, solved by doubling."""

import numpy as np

DOUBLINGS = 50  # 2^50 steps of the recursion: far more than any loop or filter needs to become steady


def solve_riccati(A: np.ndarray, G: np.ndarray, P: np.ndarray) -> np.ndarray:
    """The fixed point (n, n) of P ← Q + Aᵀ P (I + G P)⁻¹ A, which is steady whatever its start.

    With G = b bᵀ / R it is the cost-to-go of a regulator. Step k gives P after 2^k steps of the recursion. Source:
    Anderson, International Journal of Control 28 (1978). All are (n, n), G and P = Q symmetric.
    """
    for _ in range(DOUBLINGS):
        W = np.linalg.inv(np.eye(len(A)) + G @ P)
        A, G, P = A @ W @ A, G + A @ W @ G @ A.T, P + A.T @ P @ W @ A
        # Symmetric again after rounding: the next doubling builds on both.
        G, P = 0.5 * (G + G.T), 0.5 * (P + P.T)
    return P
