"""What a scan gives cause to ask, which its residuals may not show."""

import numpy as np

from profilecal.scan.scan import Scan


def doubts(scan: Scan) -> list[str]:
    """A question where x and z of raw profiles look swapped: only z runs on along most
    of them.
    """
    if scan.measured != "profiles":
        return []
    only_z = []
    for values in scan.values[:100]:
        steps = np.diff(values[np.isfinite(values).all(axis=1)], axis=0)
        if len(steps) > 9:
            x, z = (steps >= 0).all(axis=0) | (steps <= 0).all(axis=0)
            only_z.append(z and not x)
    if 2 * sum(only_z) <= len(only_z):
        return []
    return [
        "z, and not x, grows or falls all along most profiles, as x does along the "
        "laser line: are their columns swapped?"
    ]
