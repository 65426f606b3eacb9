"""Which scan extents, which the disk paper does not print (Eq. 48), give the four values that it prints for Fig. 15."""

import numpy as np
import pandas as pd
from scipy.interpolate import RectBivariateSpline

from profilecal.papers.disk_study import disk_study
from profilecal.papers.published import table
from profilecal.papers.settings import READINGS, fig15_scans

PAPER_TRIALS = 500  # behind each printed value, which knows its own spread no better than these allow


def printed_values() -> pd.DataFrame:
    """The printed values of Fig. 15: columns m, sigma_mm, published [mm], half_unit [mm]."""
    entries = table("disk").query("item == 'Fig. 15'")
    m = entries["row"].str.extract(r"m=(\d+)")[0].astype(int)
    sigma_mm = entries["component"].str.extract(r"sigma=([\d.]+)")[0].astype(float)
    columns = {"m": m, "sigma_mm": sigma_mm, "published": entries["value"], "half_unit": entries["half_unit"]}
    return pd.DataFrame(columns).reset_index(drop=True)


def errors_at(extent, printed: pd.DataFrame, trials: int, seed: int) -> np.ndarray:
    """Centre errors (rows, trials, 3), mm, at the settings of `printed`; the same noise for any `extent`."""
    scans = fig15_scans(extent)
    return np.array(
        [
            disk_study(scans, row.sigma_mm, row.m, trials, np.random.default_rng(seed)).centre_error[0, 0]
            for row in printed.itertuples()
        ]
    )


def relative_error(reading: str, errors, count: int) -> np.ndarray:
    """Standard error of a reading of *e* from `count` trials, over its value: (...) from errors (..., trials, 3)."""
    norms = np.linalg.norm(errors, axis=-1)
    value = READINGS[reading](errors)
    middle = norms.mean(axis=-1, keepdims=True)
    influence = {  # of one trial on the reading, but for a constant
        "standard deviation of the norms": (norms - middle) ** 2 / (2 * value[..., None]),
        "root mean square": norms**2 / (2 * value[..., None]),
        "mean of the norms": norms,
    }
    return influence[reading].std(axis=-1) / np.sqrt(count) / value


def misfit(reading: str, errors, printed: pd.DataFrame) -> float:
    """χ² of the printed values but for one common scale, from errors (rows, trials, 3) at their settings.

    Chance: in the 500 trials behind each printed value, in ours, and in the rounding.
    """
    off = np.log(READINGS[reading](errors) / printed["published"].to_numpy())
    rounding = (printed["half_unit"] / printed["published"]).to_numpy() / np.sqrt(3)
    chance = [relative_error(reading, errors, count) for count in (PAPER_TRIALS, errors.shape[1])]
    variance = np.square([*chance, rounding]).sum(axis=0)
    off = off - np.average(off, weights=1 / variance)
    return float((off**2 / variance).sum())


def scale_off(first, last, extent, errors, printed: pd.DataFrame, trials: int, seed: int, fine: int = 100) -> tuple:
    """Mean logarithm of ours over the printed values: first (a,), last (b,) and {reading: (a, b)} on a `fine` grid.

    Simulated for all pairs of `first` (k,) and `last` (l,), in between by splines. All pairs have the same noise, so
    few `trials` show how *e* differs between them; its level comes from the many in `errors`, made at `extent`.
    """
    grid = np.array([[errors_at((a, b), printed, trials, seed) for b in last] for a in first])
    there = errors_at(extent, printed, trials, seed)
    a, b = np.linspace(first[0], first[-1], fine), np.linspace(last[0], last[-1], fine)
    off = {}
    for reading, spread in READINGS.items():
        level = np.log(spread(errors) / spread(there) / printed["published"].to_numpy())
        mean = (np.log(spread(grid)) + level).mean(axis=-1)
        off[reading] = RectBivariateSpline(first, last, mean)(a, b)
    return a, b, off


def where_it_crosses(x, y) -> float:
    """The first x at which y, linear between the given values (n,), changes its sign; NaN if it never does."""
    for k in np.flatnonzero(np.diff(np.sign(y))):
        return float(x[k] - y[k] * (x[k + 1] - x[k]) / (y[k + 1] - y[k]))
    return np.nan
