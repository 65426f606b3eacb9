"""Several scans of one sensor: whether they belong together, what they state, and what
a sentence on one of them begins with.
"""

from collections.abc import Iterable, Sequence
from itertools import combinations

from profilecal.calibration.answer import are_the_same, fingerprints
from profilecal.geometry.checks import check_type
from profilecal.scan.scan import Scan
from profilecal.scan.tables import ScanError
from profilecal.scan.toml import Entries


def prefixes(scans: Sequence[Scan]) -> list[str]:
    """What to put before a word on one of several scans: its title."""
    if len(scans) == 1:
        return [""]
    titles = [scan.title or scan.kind for scan in scans]
    if len({*titles}) < len(titles):
        titles = [f"{title} ({k})" for k, title in enumerate(titles, 1)]
    return [f"{title}: " for title in titles]


def by_scan(scans: Sequence[Scan], sentences: Iterable[Iterable[str]]) -> list[str]:
    """The sentences on each scan, with its name before them where there are several."""
    pairs = zip(prefixes(scans), sentences, strict=True)
    return [name + sentence for name, of_scan in pairs for sentence in of_scan]


def check_different(scans: Sequence[Scan]) -> None:
    """Refuse measurements that are there twice: they would count as new ones.

    Raises ScanError.
    """
    numbered = [*enumerate(map(fingerprints, scans), 1)]
    for number, own in numbered:
        if 3 * (len(own) - len({*own})) > len(own):
            raise ScanError(f"scan {number} holds measurements twice; expected once")
    for (first, some), (second, others) in combinations(numbered, 2):
        if are_the_same(some, others):
            scan = scans[second - 1]
            raise ScanError(
                f"scan {second} ({scan.title or scan.kind}) holds the same "
                f"measurements as scan {first}; expected each measurement once"
            )


def agreed(scans: Sequence[Scan]) -> Entries:
    """What scans of one scanner and robot state of both, without the noise of a
    profile's points where features were fitted to them: theirs is to be estimated.

    Raises TypeError for what is no scan, ScanError where scans contradict each other.
    """
    if not scans:
        raise ScanError("no scans given; expected at least one")
    for scan in scans:
        check_type("scans", scan, Scan)
    fitted = any(scan.measured in ("arcs", "profiles") for scan in scans)
    stated: Entries = {}
    for scan in scans:
        own: Entries = {"mount": scan.mount, **scan.noise}
        if scan.log:
            own["delay_ms"] = scan.delay_ms
        if scan.guess is not None:
            own["guess"] = scan.guess[:3].round(3).tolist()
        if fitted:
            own.pop("profile_mm", None)
        for name, value in own.items():
            first = stated.setdefault(name, value)
            if first != value:
                raise ScanError(
                    f"{name} is {first} in one scan and {value} in another; "
                    "expected one"
                )
    return stated
