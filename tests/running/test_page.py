"""The report: one file that needs nothing else, in every state that a calibration can end in."""

import json
import re
from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
import pytest
from command import run
from scipy.spatial.transform import Rotation

from profilecal.calibrate.calibration import calibrate
from profilecal.geometry.noise import Noise
from profilecal.report import calibration, pictures
from profilecal.running import page
from profilecal.scan.folder import write_scan
from profilecal.simulate.spec import Spec, simulate_scan

EDGE = Spec(groups=8, positions=6, seed=3, title="A <bar> & more", convention="KUKA angles", noise=Noise(0.03))
PARTS = ("verdict", "answer", "for_controllers", "rejected_table")


def everything(found) -> str:
    """All words of the report, plain; all figures drawn."""
    figures = [pictures.plot_robot(found), pictures.plot_view(found), pictures.plot_residuals(found)]
    figures += [pictures.plot_directions(found)]
    figures += [figure for scan in found.scans for figure in pictures.plot_profiles(scan, found.labels(rejected=True))]
    for figure in filter(None, figures):
        figure.canvas.draw()
    plt.close("all")
    return "\n".join(getattr(calibration, name)(found).plain for name in PARTS)


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """A scan folder, what the command prints of it, and the report."""
    place = tmp_path_factory.mktemp("report")
    write_scan(simulate_scan(EDGE), place / "bar, 8 x 6")
    result = run("calibrate", place / "bar, 8 x 6", "--json", "--report", place / "report.html")
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout), (place / "report.html").read_text(encoding="utf-8")


def test_the_report_loads_nothing(written):
    _, page = written
    without_pictures = re.sub(r'src="data:image/png;base64,[^"]+"', "", page)
    assert not re.search(r"(src|href)=|//|<script|@import|url\(|<link", without_pictures)
    assert page.count("data:image/png;base64,") == 4
    assert '<meta name="viewport"' in page
    assert "@media print" in page
    assert len(page) < 2_000_000


def test_the_report_states_what_the_command_prints(written):
    answer, page = written
    T = np.array(answer["T_flange_sensor"])
    assert "translation    {:.3f}  {:.3f}  {:.3f} mm".format(*T[:3, 3]) in page
    assert "R = Rz({:.4f})".format(Rotation.from_matrix(T[:3, :3]).as_euler("ZYX", degrees=True)[0]) in page
    assert calibration.VERDICTS["ok"][0] in page
    assert "A &lt;bar&gt; &amp; more" in page
    assert "PERS tooldata" in page
    assert "import" not in page  # no code
    assert "recorded" not in page  # nor what a sweep would want
    assert "41 What motions can determine" in page  # without its link


def test_weak_scans_say_so_first_and_what_to_add():
    text = everything(calibrate([simulate_scan(replace(EDGE, spread_deg=0.4))]))
    assert text.startswith("Solved, but not well enough to rely on.")
    assert "add" in text.split("\n")[1]


@pytest.mark.parametrize("groups", [{"groups": 1, "positions": 12}, {"groups": 1, "positions": 4}])
def test_unobservable_scans_state_no_pose(groups):
    found = calibrate([simulate_scan(replace(EDGE, **groups))])
    text = everything(found)
    assert text.startswith("These measurements cannot determine the scanner's pose.")
    assert "add poses" in text.split("\n")[1]
    assert "translation " not in text
    assert "Nothing to paste." in text


def test_several_scans_and_rejected_poses_are_named():
    edge, ball = simulate_scan(EDGE), simulate_scan(replace(EDGE, kind="ball", title="Ball", groups=6, positions=4))
    values = [v.copy() for v in edge.values]
    values[10] += 5
    values[20] = values[20][:0]
    text = everything(calibrate([replace(edge, values=tuple(values)), ball]))
    assert re.search(rf"A <bar> & more +{edge.labels[10]} +\d+\.\d times the noise", text)
    assert re.search(rf"A <bar> & more +{edge.labels[20]} +nothing measured", text)
    assert "Ball: ball, radius 25 mm" in text


def test_a_scanner_that_stands_still_is_in_the_base_frame():
    text = everything(calibrate([simulate_scan(replace(EDGE, mount="eye-to-hand", convention="rotation vector"))]))
    assert "of the sensor's origin in the base frame" in text
    assert "--frame-id base" in text
    assert "the flange's" not in text


@pytest.mark.parametrize("kind", ["edge", "disk", "ball", "plane"])
def test_every_profile_is_drawn(kind):
    scan = simulate_scan(replace(EDGE, kind=kind, measured="profiles", groups=8, positions=3))
    empty = replace(scan, values=(scan.values[0][:0], *scan.values[1:]))
    figures = pictures.plot_profiles(empty)
    shown = [text.get_text().split()[0] for figure in figures for text in figure.axes[0].texts]
    assert [label for label in shown if label in scan.labels] == list(scan.labels)
    assert figures[0].axes[0].texts[0].get_text() == f"{scan.labels[0]} not found"
    plt.close("all")


def test_a_failing_notebook_gives_its_reason_and_keeps_the_old_report(tmp_path, monkeypatch):
    write_scan(simulate_scan(EDGE), tmp_path / "scan")
    book = json.loads(page.notebook().read_text(encoding="utf-8"))
    book["cells"] = book["cells"][:3]
    book["cells"][2]["source"] = ['raise RuntimeError("the reason")']
    (tmp_path / "bad.ipynb").write_text(json.dumps(book))
    monkeypatch.setattr(page, "notebook", lambda: tmp_path / "bad.ipynb")
    (tmp_path / "report.html").write_text("old")
    before = sorted(tmp_path.iterdir())
    result = run("calibrate", tmp_path / "scan", "--report", tmp_path / "report.html")
    assert result.exit_code == 1
    assert re.search(r"profilecal: no report: error in cell \d: RuntimeError: the reason$", result.stderr.strip())
    assert (tmp_path / "report.html").read_text() == "old"
    assert sorted(tmp_path.iterdir()) == before


def test_reports_that_cannot_be_written_are_refused_at_once(tmp_path, monkeypatch):
    write_scan(simulate_scan(EDGE), tmp_path / "scan")
    for path, sentence in (
        (tmp_path, "is a folder"),
        (tmp_path / "no" / "r.html", "no report can be written there"),
    ):
        result = run("calibrate", tmp_path / "scan", "--report", path)
        assert result.exit_code == 2
        assert sentence in result.stderr
        assert result.stdout == ""
    monkeypatch.setattr(page, "find_spec", lambda name: None if name == "papermill" else object())
    result = run("calibrate", tmp_path / "scan", "--report", tmp_path / "r.html")
    assert result.exit_code == 2
    assert result.stderr.startswith("profilecal: --report needs papermill, not installed here: pip install")
    assert result.stderr.count("\n") == 1
    assert not (tmp_path / "r.html").exists()
