"""Vectors as lists of their three components, each an array of any shape: faster than a last axis of three."""

import numpy as np


def cross(a, b) -> list:
    """a × b."""
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def dot(a, b):
    """a · b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def root(square, least):
    """The square root and its derivative, continued as its tangent below `least`².

    A scan plane that misses a ball or a disk has no circle or chord; a solver that tries such a pose needs a residual
    all the same, one that leads back.
    """
    inside = square > least**2
    value = np.sqrt(np.where(inside, square, least**2))
    slope = 0.5 / value
    return np.where(inside, value, (square + least**2) * slope), slope
