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
from simulated import error_of

from profilecal.calibration.calibration import calibrate
from profilecal.calibration.observe import check
from profilecal.geometry.noise import normalised_square
from profilecal.scan.folder import read_scan
from profilecal.scan.scan import ScanError

COUNT = int(os.environ.get("PROFILECAL_FUZZ", "24"))
LONGEST = 30  # seconds of one processor
BELIEVED = 5.0  # standard deviations


def corrupt(seed):
    """The folder of a seed and the names of what was done to it; one in five suffers
    twice.
    """
    rng = np.random.default_rng(seed)
    kind = ("edge", "disk", "ball")[seed % 3]
    names = list(CORRUPTIONS)
    chosen = [names[(seed // 3) % len(names)]]
    chosen += [names[rng.integers(len(names))]] if rng.uniform() < 0.2 else []
    folder, done = Folder(kind), [kind]
    for name in chosen:
        try:
            CORRUPTIONS[name](rng, folder)
            done.append(name)
        except Exception:
            if done == [kind]:
                raise
            # what the first corruption left is no table that the second one could
            # change
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
        s = found.solution
        delta = error_of(found, truth)
        sds = np.abs(delta) / np.sqrt(np.diag(s.covariance))
        size = np.sqrt(normalised_square(s.covariance, delta))
        text = f"ok, but {size:.1f} standard deviations away, {np.abs(delta[:3]).max():.3g} mm; {s.prior.how}; {said}"
        # the distance of six independent components that is as unlikely as 5 of one
        assert sds.max() <= BELIEVED, text
        assert size <= 6.3, text
    return found.status


def hung(signum, frame):
    raise AssertionError(f"still running after {4 * LONGEST} s")


def attempt(seed, path):
    """(names, outcome, seconds) of one corruption; the sentence of what must never be."""
    folder, names = corrupt(seed)
    folder.write(path)
    signal.signal(signal.SIGALRM, hung)
    signal.alarm(4 * LONGEST)  # others may keep the machine busy
    start = time.process_time()
    try:
        what = outcome(path, folder.truth, seed % 5 == 0)
    except Exception as error:
        what = f"FAILED, {type(error).__name__}: {error}"
    finally:
        signal.alarm(0)
    seconds = time.process_time() - start
    return (
        names,
        what if seconds < LONGEST else f"FAILED, took {seconds:.0f} s",
        seconds,
    )


def test_corrupted_scans_are_refused_or_doubted_or_right(tmp_path):
    """PROFILECAL_FUZZ of them, 24 if it is not set. Spread over the kinds of corruption
    in the suite's part.
    """
    seeds = range(COUNT) if 3 * len(CORRUPTIONS) <= COUNT else range(0, 10 * COUNT, 10)
    table, slowest, failed = defaultdict(Counter), (0.0, 0), []
    for seed in seeds:
        names, what, seconds = attempt(seed, tmp_path / "scan")
        shutil.rmtree(tmp_path / "scan")
        table[names[-1]][what.partition(",")[0]] += 1
        slowest = max(slowest, (seconds, seed))
        if what.startswith("FAILED"):
            failed.append(f"{seed} {'+'.join(names)}: {what}")
    print(f"\nlongest: {slowest[0]:.1f} s, of {slowest[1]}")
    for name, counts in sorted(table.items()):
        print(
            f"{name:30}",
            ", ".join(f"{count} {what}" for what, count in sorted(counts.items())),
        )
    assert not failed, "\n".join(failed)
