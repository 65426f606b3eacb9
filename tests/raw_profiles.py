"""Raw profiles of every target as a scanner with the noise of the edge paper's VLM350
sends them, and worse.

Every maker returns P profiles (P, n, 2), and where the target is in each.
"""

import numpy as np

import profilecal as pc
from profilecal.simulation.robot import Scanner

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
        height = rng.uniform(3, 30, spikes.sum())
        profile[spikes, 1] += height * rng.choice([-1, 1], spikes.sum())
        apart = np.abs(profile[:, None, 0] - points[None, :, 0])
        close = (np.nan_to_num(apart, nan=0.0) < 2).any(axis=1)
        for _ in range(2):
            start = rng.integers(n)
            rows = np.arange(start, min(n, start + rng.integers(5, 26)))
            profile[rows[~close[rows]]] = np.nan
        missing = np.isnan(profile[:, 1]) & (rng.random(n) < 0.5)
        profile[missing] = 0.0
    return profiles


def scan_planes(scan, truth):
    """Those of a simulated scan, (P, 3, 3) and (P, 3), and its target's points in them,
    (P, m, 2).
    """
    T = scan.T_base_flange @ truth.pose
    planes = T[:, :3, :3], T[:, :3, 3]
    return planes, truth.target.meet(*planes).reshape(len(T), -1, 2)


def edges(specimen, rng, groups=25):
    """Profiles of a specimen, and its edge (P, 1, 2)."""
    seen, truth = pc.simulate("edge", seed=2, groups=groups)
    planes, points = scan_planes(seen, truth)
    away = planes[0].mean(axis=0)[:, 2]
    outlines = truth.target.outline(specimen, *planes, away)
    return scan(outlines, rng), points


def scan(outlines, rng):
    """Profiles (P, n, 2) of outlines (V, 2)."""
    return np.stack([SCANNER.profile(np.array(outline), rng) for outline in outlines])


def turned(points, angle, place):
    """Points (..., 2) turned and moved."""
    c, s = np.cos(angle), np.sin(angle)
    return np.asarray(points) @ np.array([[c, s], [-s, c]]) + place


def disks(rng, count=250, background=20.0, aside=0.0):
    """Disks above a table or, with `background` None, nothing; their tips (P, 2, 2),
    smaller x first.
    """
    depth = background or 500  # mm, which is out of the scanner's range
    chains, tips = [], []
    for half in RADIUS * np.sqrt(1 - rng.uniform(0, 0.8, count) ** 2):
        angle = rng.uniform(-0.35, 0.35)
        place = np.array([aside + rng.uniform(-5, 5), rng.uniform(180, 240)])
        ends = turned([[-half, 0], [half, 0]], angle, place)
        table = turned([[-300, depth], [300, depth]], angle * 0.5, place)
        left, right = ([x, np.interp(x, *table.T)] for x in ends[:, 0])
        chains.append([table[0], left, *ends, right, table[1]])
        tips.append(ends)
    return scan(chains, rng), np.array(tips)


def arc_of(radius, middle, reach_deg):
    """Points (k, 2) on a circle about zero, to either side of an angle; lines that join
    them are on it on average.
    """
    step_deg = 1.5
    angle = middle + np.radians(np.arange(-reach_deg, reach_deg + 0.1, step_deg))
    # a line between two points is nearer to zero than they are, by this on average
    larger = radius * (1 + np.radians(step_deg) ** 2 / 12)
    return larger * np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def above_table(arc, z):
    """A chain of an arc (k, 2) and a table at a depth behind it."""
    return np.array([[-300, z], [arc[0, 0], z], *arc, [arc[-1, 0], z], [300, z]])


def balls(rng, count=250, background=30.0):
    """Balls on a table, and their circles (P, 3)."""
    r = RADIUS * np.sqrt(1 - rng.uniform(0, 0.8, count) ** 2)
    x = rng.uniform(-8, 8, count)
    z = rng.uniform(190, 240, count)
    circles = np.stack([x, z, r], axis=-1)
    arcs = [circle[:2] + arc_of(circle[2], -np.pi / 2, 90) for circle in circles]
    tables = z + background
    chains = [above_table(*pair) for pair in zip(arcs, tables, strict=True)]
    return scan(chains, rng), circles


def rods(rng, count=250, radius=RADIUS, background=30.0):
    """Rods above a table or, with `background` None, nothing, by scan planes up to 45°
    off square.

    Their ellipses (P, 4): the centre, and what of the axis' unit direction lies in the
    plane.
    """
    chains, ellipses = [], []
    for sine in np.sin(rng.uniform(0, np.pi / 4, count)):
        axis = turned([sine, 0], rng.uniform(-np.pi, np.pi), 0.0)
        cosine = np.sqrt(1 - sine**2)
        # from the rod seen along its axis
        oblique = np.eye(2) + np.outer(axis, axis) / (cosine * (1 + cosine))
        x, z = rng.uniform(-8, 8), rng.uniform(190, 240)
        centre = np.array([x, z + max(radius - RADIUS, 0)])
        # where the ellipse is square to z
        nearest = np.arctan2(*oblique[::-1, 1]) + np.pi
        arc = centre + arc_of(radius, nearest, 120) @ oblique
        if background is not None:
            arc = above_table(arc, arc[:, 1].max() + background)
        chains.append(arc)
        ellipses.append([*centre, *axis])
    return scan(chains, rng), np.array(ellipses)


def planes(rng, count=250):
    """A face with a lower table beside it, and points on the face (P, 2, 2)."""
    chains, faces = [], []
    for _ in range(count):
        angle = rng.uniform(-0.35, 0.35)
        place = [rng.uniform(-5, 5), rng.uniform(180, 240)]
        face = turned([[-40, 0], [32, 0]], angle, place)
        chains.append([*face, face[1] + [0.0, 20], face[1] + [200.0, 20]])
        faces.append(face)
    return scan(chains, rng), np.array(faces)


def tables(rng, count=250):
    """Profiles of a flat table alone: nothing to find but a plane."""
    chains = []
    for _ in range(count):
        angle, depth = rng.uniform(-0.35, 0.35), rng.uniform(150, 260)
        chains.append(turned([[-300, 0], [300, 0]], angle, [0, depth]))
    return scan(chains, rng)
