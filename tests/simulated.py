"""Simulated scans and what calibrating one gives, each computed once for all cases that read it."""

from functools import cache

from profilecal.calibrate.calibration import Calibration, calibrate
from profilecal.scan.scan import Scan
from profilecal.simulate.spec import Spec, simulate_scan


@cache
def scan_of(spec: Spec) -> Scan:
    return simulate_scan(spec)


@cache
def calibration_of(spec: Spec) -> Calibration:
    return calibrate([scan_of(spec)])
