"""Random corruptions of the example scans: never a traceback, a hang, or a wrong answer
that claims to be right.

The suite tries each kind once; `PROFILECAL_FUZZ=2000 pytest -s tests/test_fuzz.py`
tries as many as it says and prints what came of each, after its seed.
"""

import json
import os
import signal

import numpy as np
from corruptions import CORRUPTIONS, example
from numpy.random import default_rng
from simulated import error_of

import profilecal as pc
from profilecal.geometry.noise import normalised_square
from profilecal_tool.checking import check

COUNT = int(os.environ.get("PROFILECAL_FUZZ", len(CORRUPTIONS)))
LONGEST = 30  # seconds of one processor
BELIEVED = 5.0  # standard deviations of one component of the pose
# the distance of six independent components that is as unlikely
BELIEVED_OF_SIX = 6.3


def corrupt(seed):
    """The files of a seed, the pose that is right, and what was done."""
    again, which = divmod(seed, len(CORRUPTIONS))
    name = [*CORRUPTIONS][which]
    kind = ("edge", "disk", "ball")[(which + again) % 3]
    files, truth = example(kind)
    CORRUPTIONS[name](default_rng(seed), files)
    return files, truth, f"{kind}, {name}"


def outcome(path, truth, checking):
    """What calibrating a folder ends in: "refused", "ok", "weak" or "unobservable".

    Raises AssertionError for what must never be. Any exception but ScanError is such a
    thing too.
    """
    try:
        scan = pc.read_scan(path)
        if checking:
            lines = [*check(scan)]
            assert all("\n" not in text for _, text in lines), lines
        found = pc.calibrate(scan)
    except pc.ScanError as error:
        sentence = str(error)
        assert "\n" not in sentence, sentence
        assert 10 < len(sentence) < 600, sentence
        return "refused"
    result = json.loads(json.dumps(found.to_json(), allow_nan=False))
    said = " | ".join(result["messages"])
    assert len(said) < 20_000, said
    if found.status != "ok":
        assert said, "a doubtful answer without a reason"
        return found.status
    covariance, error = found.solution.covariance, error_of(found, truth)
    sds = np.abs(error) / np.sqrt(np.diag(covariance))
    distance = np.sqrt(normalised_square(covariance, error))
    text = f"ok, but {distance:.1f} standard deviations away; {said}"
    assert sds.max() <= BELIEVED, text
    assert distance <= BELIEVED_OF_SIX, text
    return "ok"


def slow(signum, frame):
    raise AssertionError(f"took {LONGEST} s")


def attempt(seed, path):
    """What came of one corruption, in a line; FAILED for what must never be."""
    files, truth, done = corrupt(seed)
    path.mkdir(exist_ok=True)
    for name, content in files.items():
        (path / name).write_bytes(content)
    signal.signal(signal.SIGVTALRM, slow)
    signal.setitimer(signal.ITIMER_VIRTUAL, LONGEST)
    try:
        result = outcome(path, truth, seed % 5 == 0)
    except Exception as error:
        result = f"FAILED, {type(error).__name__}: {error}"
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0)
    return f"{seed} {done}: {result}"


def test_corrupted_scans_are_refused_or_doubted_or_right(tmp_path):
    lines = [attempt(seed, tmp_path / "scan") for seed in range(COUNT)]
    print("", *lines, sep="\n")
    assert [line for line in lines if "FAILED" in line] == []
