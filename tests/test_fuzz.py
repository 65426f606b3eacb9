"""Random corruptions of the example scans: never a traceback, a hang, or a wrong answer
that claims to be right.

The suite tries 24; `PROFILECAL_FUZZ=2000 pytest -s tests/test_fuzz.py` tries as many as
it says and prints what came of each kind. A corruption is drawn from its own seed, the
number in a failure's first line.
"""

import json
import os
import shutil
import signal
import time
from collections import Counter, defaultdict

import numpy as np
from corruptions import CORRUPTIONS, Folder
from numpy.random import default_rng
from simulated import error_of

from profilecal.calibration.calibration import calibrate
from profilecal.geometry.noise import normalised_square
from profilecal.scan.folder import read_scan
from profilecal.scan.tables import ScanError
from profilecal_tool.checking import check

COUNT = int(os.environ.get("PROFILECAL_FUZZ", "24"))
LONGEST = 30  # seconds of one processor
BELIEVED = 5.0  # standard deviations of one component of the pose
# the distance of six independent components that is as unlikely
BELIEVED_OF_SIX = 6.3


def corrupt(seed):
    """The folder of a seed and the names of what was done to it; one in five suffers
    twice.
    """
    rng = default_rng(seed)
    kind = ("edge", "disk", "ball")[seed % 3]
    names = list(CORRUPTIONS)
    chosen = [names[(seed // 3) % len(names)]]
    if rng.uniform() < 0.2:
        chosen.append(names[rng.integers(len(names))])
    folder, done = Folder(kind), [kind]
    for name in chosen:
        try:
            CORRUPTIONS[name](rng, folder)
            done.append(name)
        except Exception:
            if done == [kind]:
                raise
            # the first corruption left no table that the second could change
    return folder, done


def outcome(path, truth, checking):
    """What calibrating a folder ends in: "refused", "ok", "weak" or "unobservable".

    Raises AssertionError for what must never be. Any exception but ScanError is such a
    thing too.
    """
    try:
        scan = read_scan(path)
        if checking:
            lines = check(scan)
            assert all("\n" not in line for line in lines), lines
        found = calibrate([scan])
    except ScanError as error:
        sentence = str(error)
        assert "\n" not in sentence, sentence
        assert 10 < len(sentence) < 600, sentence
        return "refused"
    result = json.loads(json.dumps(found.to_json(), allow_nan=False))
    said = " | ".join(result["messages"])
    assert len(said) < 20_000, said
    if found.status in ("weak", "unobservable"):
        assert said, "a doubtful answer without a reason"
    if found.status == "ok":
        check_right(found, truth, said)
    return found.status


def check_right(found, truth, said):
    """Raise AssertionError where an answer is farther from the truth than it says."""
    covariance = found.solution.covariance
    error = error_of(found, truth)
    sds = np.abs(error) / np.sqrt(np.diag(covariance))
    distance = np.sqrt(normalised_square(covariance, error))
    text = (
        f"ok, but {distance:.1f} standard deviations away, "
        f"{np.abs(error[:3]).max():.3g} mm; {found.solution.prior.source}; {said}"
    )
    assert sds.max() <= BELIEVED, text
    assert distance <= BELIEVED_OF_SIX, text


def hung(signum, frame):
    raise AssertionError(f"still running after {4 * LONGEST} s")


def attempt(seed, path):
    """(names, outcome, seconds) of one corruption; the outcome begins with FAILED for
    what must never be.
    """
    folder, names = corrupt(seed)
    folder.write(path)
    signal.signal(signal.SIGALRM, hung)
    signal.alarm(4 * LONGEST)  # others may keep the machine busy
    start = time.process_time()
    try:
        result = outcome(path, folder.truth, seed % 5 == 0)
    except Exception as error:
        result = f"FAILED, {type(error).__name__}: {error}"
    finally:
        signal.alarm(0)
    seconds = time.process_time() - start
    if seconds >= LONGEST:
        result = f"FAILED, took {seconds:.0f} s"
    return names, result, seconds


def show(table, slowest):
    """Print what came of each kind of corruption."""
    seconds, seed = slowest
    print(f"\nlongest: {seconds:.1f} s, of {seed}")
    for name, counts in sorted(table.items()):
        outcomes = [f"{count} {result}" for result, count in sorted(counts.items())]
        print(f"{name:30}", ", ".join(outcomes))


def test_corrupted_scans_are_refused_or_doubted_or_right(tmp_path):
    """PROFILECAL_FUZZ of them, 24 if it is not set; these few are spread over the kinds
    of corruption.
    """
    every_kind = 3 * len(CORRUPTIONS) <= COUNT
    seeds = range(COUNT) if every_kind else range(0, 10 * COUNT, 10)
    table, slowest, failed = defaultdict(Counter), (0.0, 0), []
    for seed in seeds:
        names, result, seconds = attempt(seed, tmp_path / "scan")
        shutil.rmtree(tmp_path / "scan")
        table[names[-1]][result.partition(",")[0]] += 1
        slowest = max(slowest, (seconds, seed))
        if result.startswith("FAILED"):
            failed.append(f"{seed} {'+'.join(names)}: {result}")
    show(table, slowest)
    assert not failed, "\n".join(failed)
