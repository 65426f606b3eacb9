"""Noise studies of the disk and ball methods at any size: batched, in chunks, the same on any number of workers."""

import os
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from tqdm import tqdm

from profilecal.geometry.fitting import ROUNDS
from profilecal.geometry.poses import nearest_rotation

CHUNK = 1000  # trials that share one random stream: memory stays flat, and workers wait little for each other


def _run_all(run, tasks, workers: int | None) -> None:
    """Run all tasks on threads (NumPy leaves the interpreter lock while it computes), with a progress bar."""
    with ThreadPoolExecutor(max_workers=workers or os.cpu_count()) as pool:
        for _ in tqdm(pool.map(run, tasks), total=len(tasks), disable=None, leave=False):
            pass


def _solve(scans, R_tcp, q, T_tcp, X, Y):
    """Eqs 14-20: rotation from X (k, n, 3) and Y (n, 3), translation from R_tcp (l, 3, 3), q and T_tcp (k, l, 3).

    Returns the fixed point (k, 3), mm, the errors of rotation (k, 3), rad, and translation (k, 3), mm, and which trials
    took the SVD. The flange orientations are the same in all trials: the least squares of Eq. 19 is one fixed matrix.
    """
    X = X / np.linalg.norm(X, axis=-1, keepdims=True)
    Y = Y / np.linalg.norm(Y, axis=-1, keepdims=True)
    turn, by_svd = rotations_near(X @ scans.R_sensor.T, Y)

    seen = np.einsum("nab,knb->kna", R_tcp, (q @ scans.R_sensor.T) @ np.swapaxes(turn, -1, -2)) + T_tcp
    M = (R_tcp[:-1] - R_tcp[1:]).reshape(-1, 3)
    N = (seen[:, 1:] - seen[:, :-1]).reshape(len(seen), -1)
    T_sensor = N @ np.linalg.pinv(M).T
    point = seen.mean(axis=1) + T_sensor @ R_tcp.mean(axis=0).T
    return point, _rotation_vectors(turn), T_sensor - scans.T_sensor, by_svd


def _rotation_vectors(R) -> np.ndarray:
    """Rotation vectors (k, 3) of rotations (k, 3, 3) by less than a half turn: scipy's, without its detour."""
    skew = (R - np.swapaxes(R, -1, -2)) / 2
    sine_axis = np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=-1)
    sine = np.linalg.norm(sine_axis, axis=-1)
    angle = np.arctan2(sine, (np.trace(R, axis1=-2, axis2=-1) - 1) / 2)
    return sine_axis * (angle / np.maximum(sine, np.finfo(float).tiny))[:, None]


def rotations_near(X, Y) -> tuple[np.ndarray, np.ndarray]:
    """The rotations R (k, 3, 3), expected near the identity, that best take unit vectors X (k, n, 3) to Y (n, 3).

    Davenport's quaternion q maximises qᵀ K q; with q = (1, g), its eigenvalue solves a scalar equation by Newton's
    steps. q has no such form for a half turn, so what is not surely within a quarter turn is solved by SVD; the flags
    (k,) say where.
    """
    B = np.einsum("...na,...nb->...ab", np.broadcast_to(Y, X.shape), X)
    trace = np.trace(B, axis1=-2, axis2=-1)
    S = np.moveaxis(B + np.swapaxes(B, -1, -2), 0, -1)
    z = np.stack([B[:, 2, 1] - B[:, 1, 2], B[:, 0, 2] - B[:, 2, 0], B[:, 1, 0] - B[:, 0, 1]])
    value = np.full(len(X), float(X.shape[1]))
    with np.errstate(all="ignore"):
        for _ in range(ROUNDS):
            a, b, c = (value + trace) - S[0, 0], (value + trace) - S[1, 1], (value + trace) - S[2, 2]
            d, e, f = -S[0, 1], -S[0, 2], -S[1, 2]
            adjugate = (b * c - f * f, e * f - c * d, d * f - b * e, a * c - e * e, d * e - a * f, a * b - d * d)
            determinant = a * adjugate[0] + d * adjugate[1] + e * adjugate[2]
            p, q, r, s, t, u = adjugate
            g = np.stack(
                [p * z[0] + q * z[1] + r * z[2], q * z[0] + s * z[1] + t * z[2], r * z[0] + t * z[1] + u * z[2]]
            )
            g /= determinant
            square = np.einsum("ak,ak->k", g, g)
            step = (trace - value + np.einsum("ak,ak->k", z, g)) / (1 + square)
            value = value + step
            if not (np.abs(step) > 4e-16 * X.shape[1]).any():
                break
        skew = np.zeros((len(X), 3, 3))
        skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0] = g
        skew -= np.swapaxes(skew, -1, -2)
        R = np.eye(3) + 2 * (skew + skew @ skew) / (1 + square)[:, None, None]
        sure = (determinant > 0) & (a > 0) & (a * b > d * d) & (square < 1) & (np.abs(step) < 1e-12)
    if not sure.all():
        rest = ~sure & np.isfinite(B).all(axis=(1, 2))
        R[~sure] = np.nan
        R[rest] = nearest_rotation(B[rest])
    return R, ~sure


# the three readings of "the standard deviation e" of the disk paper, from errors (..., trials, 3) to (...)
READINGS = {
    "standard deviation of the norms": lambda errors: np.linalg.norm(errors, axis=-1).std(axis=-1),
    "root mean square": lambda errors: np.sqrt((errors**2).sum(axis=-1).mean(axis=-1)),
    "mean of the norms": lambda errors: np.linalg.norm(errors, axis=-1).mean(axis=-1),
}
