"""Simulated scans and what calibrating one gives, each computed once for all cases that read it."""

from functools import wraps

from profilecal.calibrate.calibration import Calibration, calibrate
from profilecal.scan.scan import Scan
from profilecal.simulate.spec import Spec, simulate_scan


def once(function):
    """A function of a specification that remembers its answers, by the specification's text: it may hold a dict."""
    known = {}

    @wraps(function)
    def remembering(spec: Spec):
        key = repr(spec)
        if key not in known:
            known[key] = function(spec)
        return known[key]

    return remembering


@once
def scan_of(spec: Spec) -> Scan:
    return simulate_scan(spec)


@once
def calibration_of(spec: Spec) -> Calibration:
    return calibrate([scan_of(spec)])
