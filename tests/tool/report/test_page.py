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
PICTURE = re.compile(r'src="data:image/png;base64,[^"]+"')


@pytest.fixture(scope="module")
def scan(tmp_path_factory):
    """A small scan folder."""
    place = tmp_path_factory.mktemp("scan") / "bar, 8 x 6"
    write_scan(simulate_scan(EDGE), place)
    return place


@pytest.fixture(scope="module")
def written(scan):
    """What the command prints of the scan, and the report."""
    path = scan.parent / "report.html"
    result = run("calibrate", scan, "--json", "--report", path)
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout), path.read_text(encoding="utf-8")


def test_the_report_loads_nothing(written):
    _, report = written
    links = r"(src|href)=|//|<script|@import|url\(|<link"
    assert not re.search(links, PICTURE.sub("", report))
    assert len(PICTURE.findall(report)) == 4
    assert '<meta name="viewport"' in report
    assert "@media print" in report
    assert len(report) < 2_000_000


def test_the_report_states_what_the_command_prints(written):
    answer, report = written
    T = np.array(answer["T_flange_sensor"])
    x, y, z = T[:3, 3]
    yaw, _, _ = Rotation.from_matrix(T[:3, :3]).as_euler("ZYX", degrees=True)
    assert f"translation    {x:.3f}  {y:.3f}  {z:.3f} mm" in report
    assert f"R = Rz({yaw:.4f})" in report
    # the line for the robot of these angles
    assert f"{{X {x:.3f},Y {y:.3f},Z {z:.3f},A " in report
    assert VERDICTS["ok"][0].partition("{")[0] in report
    assert "A &lt;bar&gt; &amp; more" in report


def test_the_report_has_no_code_no_records_and_no_links(written):
    _, report = written
    assert "import" not in report
    assert "recorded" not in report  # what a sweep would want
    assert "41 What motions can determine" in report  # without its link


def test_a_failing_notebook_gives_its_reason_and_keeps_the_old_report(
    scan, tmp_path, monkeypatch
):
    reason = 'raise RuntimeError("the reason")'
    bad = write_notebook(tmp_path / "bad.ipynb", "scan: list = []", reason)
    monkeypatch.setattr(page, "notebook", lambda: bad)
    report = tmp_path / "report.html"
    report.write_text("old")
    result = run("calibrate", scan, "--report", report)
    assert result.exit_code == 1
    sentence = r"profilecal: no report: error in cell \d: RuntimeError: the reason\n$"
    assert re.search(sentence, result.stderr)
    assert report.read_text() == "old"
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == ["bad.ipynb", "report.html"]


@pytest.mark.parametrize(
    ("place", "sentence"),
    [
        ("report.pdf", "expected a name that ends in .html or .htm"),
        ("folder.html", "is a folder; name a file for the report"),
        ("no/report.html", "no report can be written there"),
    ],
)
def test_a_report_that_cannot_be_written_is_refused_at_once(
    scan, tmp_path, place, sentence
):
    (tmp_path / "folder.html").mkdir()
    result = run("calibrate", scan, "--report", tmp_path / place)
    assert (result.exit_code, result.stdout) == (2, "")
    assert sentence in result.stderr


def test_without_its_packages_a_report_is_refused_at_once(scan, tmp_path, monkeypatch):
    def without_papermill(name):
        return None if name == "papermill" else object()

    monkeypatch.setattr(page, "find_spec", without_papermill)
    result = run("calibrate", scan, "--report", tmp_path / "report.html")
    assert result.exit_code == 2
    assert result.stderr == (
        "profilecal: --report needs papermill, not installed here: "
        'pip install "profilecal[notebooks]"\n'
    )
    assert not (tmp_path / "report.html").exists()
