"""What memory there is, and scans that it does not hold."""

import resource
import subprocess
import sys

import pytest
from simulated import scan_of

import profilecal as pc
from profilecal.calibration import memory


def test_as_many_profiles_as_would_fit_are_solved(monkeypatch):
    monkeypatch.setattr(memory, "memory_limit", lambda: 1e6)
    sentence = (
        "250 profiles take 0.0024 GB of memory, of which there are 0.001; 103 would"
    )
    with pytest.raises(pc.ScanError, match=sentence):
        pc.calibrate(pc.simulate("edge", seed=1)[0])
    fitting = scan_of("edge", seed=1, groups=25, positions=4)
    assert pc.calibrate(fitting).status == "ok"


GROUPS = {  # of this process, files of limits, and the least of these
    "none": ("", {}, None),
    "a container": (
        "0::/pod/box\n",
        {"memory.max": "max", "pod/memory.max": "3000", "pod/box/memory.max": "max"},
        3000,
    ),
    "a container, as seen from within": ("0::/\n", {"memory.max": "5000"}, 5000),
}


@pytest.mark.parametrize(("groups", "files", "least"), GROUPS.values(), ids=GROUPS)
def test_the_limits_of_containers_count(groups, files, least, tmp_path):
    texts = {"proc/self/cgroup": groups}
    texts |= {f"sys/fs/cgroup/{name}": f"{text}\n" for name, text in files.items()}
    for name, text in texts.items():
        file = tmp_path / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
    limit = memory.memory_limit(tmp_path)
    assert limit == least if least else limit > 1e8


def test_the_limit_of_the_process_counts():
    limit = 6_000_000_000
    code = (
        "from profilecal.calibration.memory import memory_limit; print(memory_limit())"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (limit, limit)),
        capture_output=True,
        check=True,
        text=True,
    )
    assert float(done.stdout) <= limit
