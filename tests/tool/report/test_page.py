"""The report as a file: it needs nothing else, and is whole or not there."""

import json
import re

import numpy as np
import pytest
from command import run, write_notebook
from scipy.spatial.transform import Rotation

from profilecal.geometry.noise import Noise
from profilecal.scan.folder import write_scan
from profilecal.simulation.spec import Spec, simulate_scan
from profilecal_tool.report import page
from profilecal_tool.report.calibration import VERDICTS

EDGE = Spec(
    groups=8,
    positions=6,
    seed=3,
    title="A <bar> & more",
    convention="KUKA angles",
    noise=Noise(0.03),
)


@pytest.fixture(scope="module")
def scan(tmp_path_factory):
    """A small scan folder."""
    place = tmp_path_factory.mktemp("scan") / "bar, 8 x 6"
    write_scan(simulate_scan(EDGE), place)
    return place


@pytest.fixture(scope="module")
def written(scan):
    """What the command prints of the scan, and the report."""
    result = run("calibrate", scan, "--json", "--report", scan.parent / "report.html")
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout), (scan.parent / "report.html").read_text(
        encoding="utf-8"
    )


def test_the_report_loads_nothing(written):
    _, page = written
    without_pictures = re.sub(r'src="data:image/png;base64,[^"]+"', "", page)
    assert not re.search(
        r"(src|href)=|//|<script|@import|url\(|<link", without_pictures
    )
    assert page.count("data:image/png;base64,") == 4
    assert '<meta name="viewport"' in page
    assert "@media print" in page
    assert len(page) < 2_000_000


def test_the_report_states_what_the_command_prints(written):
    answer, page = written
    T = np.array(answer["T_flange_sensor"])
    assert "translation    {:.3f}  {:.3f}  {:.3f} mm".format(*T[:3, 3]) in page
    assert (
        "R = Rz({:.4f})".format(
            Rotation.from_matrix(T[:3, :3]).as_euler("ZYX", degrees=True)[0]
        )
        in page
    )
    assert VERDICTS["ok"][0].partition("{")[0] in page
    assert "A &lt;bar&gt; &amp; more" in page
    assert (
        "{{X {:.4f},Y {:.4f},Z {:.4f},A ".format(*T[:3, 3]) in page
    )  # the line for the robot of these angles
    assert "import" not in page  # no code
    assert "recorded" not in page  # nor what a sweep would want
    assert "41 What motions can determine" in page  # without its link


def test_a_failing_notebook_gives_its_reason_and_keeps_the_old_report(
    scan, tmp_path, monkeypatch
):
    bad = write_notebook(
        tmp_path / "bad.ipynb", "scan: list = []", 'raise RuntimeError("the reason")'
    )
    monkeypatch.setattr(page, "notebook", lambda: bad)
    (tmp_path / "report.html").write_text("old")
    result = run("calibrate", scan, "--report", tmp_path / "report.html")
    assert result.exit_code == 1
    assert re.search(
        r"profilecal: no report: error in cell \d: RuntimeError: the reason$",
        result.stderr.strip(),
    )
    assert (tmp_path / "report.html").read_text() == "old"
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "bad.ipynb",
        "report.html",
    ]


def test_reports_that_cannot_be_written_are_refused_at_once(
    scan, tmp_path, monkeypatch
):
    for place, sentence in (
        (tmp_path, "is a folder"),
        (tmp_path / "no" / "r.html", "no report can be written there"),
    ):
        result = run("calibrate", scan, "--report", place)
        assert (result.exit_code, result.stdout) == (2, "")
        assert sentence in result.stderr
    monkeypatch.setattr(
        page, "find_spec", lambda name: None if name == "papermill" else object()
    )
    result = run("calibrate", scan, "--report", tmp_path / "r.html")
    assert result.exit_code == 2
    assert result.stderr.startswith(
        "profilecal: --report needs papermill, not installed here: pip install"
    )
    assert result.stderr.count("\n") == 1
    assert not (tmp_path / "r.html").exists()
