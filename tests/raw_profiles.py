"""Raw profiles of every target as a scanner with the noise of the edge paper's VLM350
sends them, and worse.
"""

import numpy as np

from profilecal.geometry.noise import Noise
from profilecal.simulation.robot import Scanner, actual_poses, scan_planes
from profilecal_papers.edge_study import EdgePlan, edge_scenes

SCANNER = Scanner()
RADIUS = 25.0  # mm of disks and balls


def spoil(profiles, truth, rng):
    """Profiles (P, n, 2) with 1 % spikes, two gaps of up to 25 points each, and zeros
    for half of what is missing.

    The gaps leave the 2 mm around each of the true points (P, m, 2) alone: the feature
    stays visible.
    """
    profiles = profiles.copy()
    for profile, points in zip(profiles, truth, strict=True):
        n = len(profile)
        spikes = rng.random(n) < 0.01
        profile[spikes, 1] += rng.uniform(3, 30, spikes.sum()) * rng.choice(
            [-1, 1], spikes.sum()
        )
        apart = np.abs(profile[:, None, 0] - points[None, :, 0])
        close = (np.nan_to_num(apart, nan=0.0) < 2).any(axis=1)
        for _ in range(2):
            start = rng.integers(n)
            rows = np.arange(start, min(n, start + rng.integers(5, 26)))
            profile[rows[~close[rows]]] = np.nan
        missing = np.isnan(profile[:, 1]) & (rng.random(n) < 0.5)
        profile[missing] = 0.0
    return profiles


def edges(specimen, rng, groups=25):
    """Profiles (P, n, 2) of a specimen, and its edge (P, 1, 2)."""
    scene = edge_scenes(
        EdgePlan(groups=groups, spread_deg=20, frame="group", radius=15), Noise(), rng
    )
    rotation, origin = scan_planes(
        scene.R_sensor, scene.T_sensor, *actual_poses(scene.poses, Noise(), rng)
    )
    away = rotation.mean(axis=(0, 1))[:, 2]
    outline = scene.edge.outline(specimen, rotation, origin, away)
    return scan(outline, rng).reshape(-1, SCANNER.points, 2), scene.points.reshape(
        -1, 1, 2
    )


def scan(outlines, rng):
    """Profiles (P, n, 2) of outlines (P, V, 2)."""
    return SCANNER.profile(np.asarray(outlines), rng)


def turned(points, angle, place):
    """Points (..., 2) turned and moved."""
    c, s = np.cos(angle), np.sin(angle)
    return np.asarray(points) @ np.array([[c, s], [-s, c]]) + place


def disks(rng, count=250, background=20.0, aside=0.0):
    """Profiles of disks above a table or, with `background` None, nothing; their tips
    (P, 2, 2), smaller x first.
    """
    half = RADIUS * np.sqrt(1 - rng.uniform(0, 0.8, count) ** 2)
    chains, tips = [], []
    for h in half:
        angle, place = (
            rng.uniform(-0.35, 0.35),
            np.array([aside + rng.uniform(-5, 5), rng.uniform(180, 240)]),
        )
        ends = turned([[-h, 0], [h, 0]], angle, place)
        table = turned(
            [[-300, background or 500], [300, background or 500]], angle * 0.5, place
        )
        below = [[x, np.interp(x, *table.T)] for x in ends[:, 0]]
        chains.append([table[0], below[0], *ends, below[1], table[1]])
        tips.append(ends)
    return scan(chains, rng), np.array(tips)


def arc_of(radius, middle, reach_deg):
    """Points (k, 2) on a circle about zero, to either side of an angle; lines that join
    them are on it on average.
    """
    angle = middle + np.radians(np.arange(-reach_deg, reach_deg + 0.1, 1.5))
    return (
        radius
        * (1 + np.radians(1.5) ** 2 / 12)
        * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    )


def above_table(arc, z):
    """A chain of an arc (k, 2) and a table at a depth behind it."""
    return np.array([[-300, z], [arc[0, 0], z], *arc, [arc[-1, 0], z], [300, z]])


def balls(rng, count=250, background=30.0):
    """Profiles of balls on a table, and their circles (P, 3)."""
    r = RADIUS * np.sqrt(1 - rng.uniform(0, 0.8, count) ** 2)
    circles = np.stack(
        [rng.uniform(-8, 8, count), rng.uniform(190, 240, count), r], axis=-1
    )
    chains = [
        above_table(c[:2] + arc_of(c[2], -np.pi / 2, 90), c[1] + background)
        for c in circles
    ]
    return scan(chains, rng), circles


def rods(rng, count=250, radius=RADIUS, background=30.0):
    """Profiles of rods above a table or, with `background` None, nothing, by scan
    planes up to 45° off square.

    Their ellipses (P, 4): the centre, and what of the axis' unit direction lies in the
    plane.
    """
    chains, ellipses = [], []
    for sine in np.sin(rng.uniform(0, np.pi / 4, count)):
        axis = turned([sine, 0], rng.uniform(-np.pi, np.pi), 0.0)
        cosine = np.sqrt(1 - sine**2)
        # from the rod seen along its axis
        oblique = np.eye(2) + np.outer(axis, axis) / (cosine * (1 + cosine))
        centre = np.array(
            [rng.uniform(-8, 8), rng.uniform(190, 240) + max(radius - RADIUS, 0)]
        )
        # where the ellipse is square to z
        nearest = np.arctan2(*oblique[::-1, 1]) + np.pi
        arc = centre + arc_of(radius, nearest, 120) @ oblique
        if background is not None:
            arc = above_table(arc, arc[:, 1].max() + background)
        chains.append(arc)
        ellipses.append([*centre, *axis])
    return scan(chains, rng), np.array(ellipses)


def planes(rng, count=250):
    """Profiles of a face with a lower table beside it, and points on the face (P, 2,
    2).
    """
    faces = [
        turned(
            [[-40, 0], [32, 0]],
            rng.uniform(-0.35, 0.35),
            [rng.uniform(-5, 5), rng.uniform(180, 240)],
        )
        for _ in range(count)
    ]
    chains = [[*face, face[1] + [0.0, 20], face[1] + [200.0, 20]] for face in faces]
    return scan(chains, rng), np.array(faces)


def tables(rng, count=250):
    """Profiles of a flat table alone: nothing to find but a plane."""
    table = [[-300, 0], [300, 0]]
    chains = [
        turned(table, rng.uniform(-0.35, 0.35), [0, rng.uniform(150, 260)])
        for _ in range(count)
    ]
    return scan(chains, rng)
