"""Trials of the disk's noise study one by one, which its fast paths must equal."""

import numpy as np
from scipy.spatial.transform import Rotation

from profilecal.closed_form.disk import disk_equations, sensing_data


def noisy_tips(scans, sigma, m, noise, rng, trials):
    """The tips (trials, n, m, 2, 2) that the engine's stream stands for, put together
    as Eq. 52 says.
    """
    exact = scans.tips(m)
    chords = exact[:, :, 1] - exact[:, :, 0]
    directions = chords / np.linalg.norm(chords, axis=-1, keepdims=True)
    tips = np.repeat(exact[None], trials, axis=0)
    for i, along in enumerate(directions):
        if noise == "chord":
            u = sigma * rng.standard_normal((trials, 2, m, 1))
            moved = u * along
        else:
            u, v = sigma * rng.standard_normal((trials, 2, 2, m, 1)).swapaxes(0, 1)
            across = np.stack([-along[:, 1], along[:, 0]], axis=-1)
            moved = u * along + v * across
        tips[:, i] += moved.swapaxes(1, 2)
    return tips


def one_by_one(scans, sigma, m, trials, rng, noise="chord", heights="regression"):
    """Centre, rotation and translation errors (trials, 9), scan by scan."""
    stream = rng.spawn(1)[0]
    errors = []
    for tips in noisy_tips(scans, sigma, m, noise, stream, trials):
        scan_by_scan = zip(tips, scans.T_start, scans.T_end, scans.s, strict=True)
        data = [sensing_data(*of, scans.disk.radius, heights) for of in scan_by_scan]
        sensed = zip(*((of.T_tcp, of.q, of.D_i, of.D_b) for of in data), strict=True)
        found = disk_equations(scans.R_tcp, *map(np.array, sensed))
        centre = found.translation.q_b - scans.disk.centre
        turn = Rotation.from_matrix(found.R_sensor @ scans.R_sensor.T).as_rotvec()
        errors.append([*centre, *turn, *(found.T_sensor - scans.T_sensor)])
    return np.array(errors)
