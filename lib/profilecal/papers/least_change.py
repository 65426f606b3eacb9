"""The least change of some numbers with which what is computed from them comes out as wanted."""

import numpy as np
from scipy.optimize import linprog

ROUNDS = 60  # at most; ten to thirty are usual
STEP = 1e-4  # of the differences that stand for derivatives
SETTLED = 1e-4  # change from one round to the next, and of the trust, at which the search ends
INSIDE = 0.99  # of the way from the middle of an interval to its ends: room for what is not linear
DEAR = 10.0  # cost of missing an interval by its own half width, where a change of 1 costs 1


def least_change(compute, low, high, size: int) -> tuple[np.ndarray, float]:
    """The x (size,) with the smallest max |x| at which all values of `compute` lie between `low` and `high` (k,).

    `compute` maps (..., size) to (..., k). Each round puts derivatives at the last x in its place and solves what is
    left, a linear program, no farther than `trust` away, a distance that grows or shrinks with how well that went
    (sequential linear programming with an exact penalty). Where the values curve, the program is solved once more with
    what the values at its solution really are (Fletcher 1982). Returns x and max |x|; infinity if an interval is
    missed.
    """
    middle, half = (low + high) / 2, (high - low) / 2

    def look(y):
        found = (compute(y) - middle) / half
        return found, _cost(y, found)

    x, trust, J = np.zeros(size), 1.0, None
    values, cost = look(x)
    for _ in range(ROUNDS):
        if J is None:  # of a new x
            moved = (compute(x + STEP * np.vstack([np.eye(size), -np.eye(size)])) - middle) / half
            J = (moved[:size] - moved[size:]).T / (2 * STEP)
        constant = values - J @ x
        tried = _linear_least_change(J, constant, x, trust)
        promised = cost - _cost(tried, J @ tried + constant)
        if promised < SETTLED or trust < SETTLED:
            break
        found, after = look(tried)
        if cost - after < 0.75 * promised:  # the second-order correction
            again = _linear_least_change(J, found - J @ tried, x, trust)
            seen, less = look(again)
            if less < after:
                tried, found, after = again, seen, less
        if cost - after > 0.75 * promised:
            trust = max(trust, 2 * np.abs(tried - x).max())
        elif cost - after < 0.25 * promised:
            trust = trust / 4
        if after < cost:
            x, values, cost, J = tried, found, after, None
    return x, np.abs(x).max() if np.abs(values).max() <= 1 else np.inf


def _cost(x, values) -> float:
    return np.abs(x).max() + DEAR * max(np.abs(values).max() - INSIDE, 0)


def _linear_least_change(J, constant, x, trust: float) -> np.ndarray:
    """The y within `trust` of x that costs least, if the values are J y + constant: a linear program in (y, s, t)."""
    k, size = J.shape
    one, rows = np.ones((size, 1)), np.ones((k, 1))
    A = np.block(
        [
            [J, 0 * rows, -rows],  # |J y + constant| ≤ INSIDE + t
            [-J, 0 * rows, -rows],
            [np.eye(size), -one, 0 * one],  # |y| ≤ s
            [-np.eye(size), -one, 0 * one],
        ]
    )
    b = np.concatenate([INSIDE - constant, INSIDE + constant, np.zeros(2 * size)])
    bounds = [*zip(x - trust, x + trust, strict=True), (0, None), (0, None)]
    return linprog(np.r_[np.zeros(size), 1, DEAR], A, b, bounds=bounds).x[:size]
