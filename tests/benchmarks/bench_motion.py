"""Scans in motion, from files to an answer with the delay between both clocks."""

from bench_volume import within

WEAVING = {"pattern": "weave"}
# in the manner of LVS_ST_CALIB, a public simulator of such scans: 10,024 points
LVS = {"sweeps": 14, "profiles": 716, "speed": 40.0, "delay_ms": -12.0, "turn_deg": 3.0}
LVS_NOISE = {"profile_mm": 0.02, "jitter_ms": 0.25}


def rows() -> list[dict]:
    return [
        within(3, 2000, "motion: 24 sweeps of 60 edge points", "edge", motion=WEAVING),
        within(
            20,
            2000,
            "motion: 14 sweeps of 716 edge points",
            "edge",
            noise=LVS_NOISE,
            motion=WEAVING | LVS,
        ),
    ]
