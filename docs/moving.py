"""Pictures that move: computed for all positions of their sliders, drawn as stills, moved by a little script."""

import json

import numpy as np

from profilecal.geometry.noise import Noise
from profilecal.joint.observability import BY_HAND_DEG, BY_HAND_MM, WEAK, spectrum
from profilecal.joint.problem import Problem
from profilecal.papers.disk_study import disk_study
from profilecal.papers.edge_plan import EdgePlan
from profilecal.papers.edge_scenes import edge_scenes, observations_of
from profilecal.papers.settings import READINGS, fig15_scans

TILTS, SPREADS, NOISES = [0, 5, 10, 20, 30, 45, 60, 90], [2, 5, 10, 20, 30, 45, 60], [0.01, 0.02, 0.05, 0.1, 0.2]
SIGMAS, CHORDS = np.arange(1, 10) / 10, np.arange(10, 201, 10)
SCENES, TRIALS = 50, 100
WIDTH, HEIGHT, LEFT, BOTTOM = 600, 260, 60, 40


def edge_directions() -> np.ndarray:
    """Standard deviations (tilts, spreads, 6) of the sensor pose's directions over a mount measured by hand, worst
    first, at 1 mm of noise: medians over random scenes of the edge paper's arcs."""
    found = np.empty((len(TILTS), len(SPREADS), 6))
    for (i, j), _ in np.ndenumerate(found[..., 0]):
        plan = EdgePlan(tilt_deg=TILTS[i], spread_deg=SPREADS[j])
        scene = edge_scenes(plan, Noise(), np.random.default_rng(0), (SCENES,))
        problem = Problem([observations_of(scene)], Noise(1.0))
        state = problem.place(scene.R_sensor, scene.T_sensor)
        information = problem.moments(state).normal[:, :-1, :-1]
        found[i, j] = np.median(spectrum(information, problem.units).sd, axis=0)
    return found


def chord_curves() -> np.ndarray:
    """e (sigmas, chords) of the disk paper's Fig. 15, mm."""
    study = disk_study(fig15_scans(), SIGMAS, CHORDS, TRIALS, np.random.default_rng(15))
    return next(iter(READINGS.values()))(study.centre_error)


def bars(values) -> str:
    """Six bars on a logarithmic scale from 1e-4 to 10, coloured by what they mean."""
    shapes = []
    for level, word in ((1, "measured by hand"), (WEAK, "weak above")):
        y = height(level)
        shapes.append(f"<line x1='{LEFT}' x2='{WIDTH}' y1='{y:.1f}' y2='{y:.1f}' stroke='#888' stroke-dasharray='4'/>")
        shapes.append(f"<text x='{WIDTH - 4}' y='{y - 4:.1f}' text-anchor='end' font-size='12'>{word}</text>")
    for k, value in enumerate(values):
        x, y = LEFT + 20 + 88 * k, height(value)
        colour = "#009E73" if value < WEAK else "#E69F00" if value < 1 else "#D55E00"
        shapes.append(
            f"<rect class='bar' x='{x}' width='60' y='{y:.1f}' height='{HEIGHT - BOTTOM - y:.1f}' fill='{colour}'/>"
        )
        name = ("worst", "2nd", "3rd", "4th", "5th", "best")[k]
        shapes.append(f"<text x='{x + 30}' y='{HEIGHT - 20}' text-anchor='middle' font-size='12'>{name}</text>")
    return svg(shapes, "standard deviation of the sensor pose's directions")


def height(value) -> float:
    """Where a standard deviation ends."""
    return float(np.clip((HEIGHT - BOTTOM) * (1 - np.log10(value)) / 5, 2, HEIGHT - BOTTOM))


def curves(e, which: int) -> str:
    """All curves of Fig. 15, one of them bold."""
    x = LEFT + (WIDTH - LEFT - 10) * CHORDS / CHORDS[-1]
    shapes = []
    for k, curve in enumerate(e):
        points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, (HEIGHT - BOTTOM) * (1 - curve / e.max()), strict=True))
        bold = "stroke='#0072B2' stroke-width='4'" if k == which else "stroke='#bbb' stroke-width='1'"
        shapes.append(f"<polyline class='curve' points='{points}' fill='none' {bold}/>")
    for m in (10, 50, 100, 150, 200):
        at = LEFT + (WIDTH - LEFT - 10) * m / CHORDS[-1]
        shapes.append(f"<text x='{at:.0f}' y='{HEIGHT - 20}' text-anchor='middle' font-size='12'>{m}</text>")
    for value in np.arange(0.5, e.max(), 0.5):
        y = (HEIGHT - BOTTOM) * (1 - value / e.max())
        shapes.append(f"<text x='{LEFT - 8}' y='{y + 4:.1f}' text-anchor='end' font-size='12'>{value:g} mm</text>")
    return svg(shapes, "error of the disk's centre over the number of chords")


def svg(shapes, label: str) -> str:
    axis = f"<line x1='{LEFT}' x2='{WIDTH}' y1='{HEIGHT - BOTTOM}' y2='{HEIGHT - BOTTOM}' stroke='black'/>"
    return f"<svg viewBox='0 0 {WIDTH} {HEIGHT}' role='img' aria-label=\"{label}\">{axis}{''.join(shapes)}</svg>"


def slider(name: str, words: str, values, start: int, unit: str) -> str:
    shown = f"<output id='{name}-value'>{values[start]:g}{unit}</output>"
    limits = f"min='0' max='{len(values) - 1}' value='{start}'"
    return f"<label>{words} <input type='range' id='{name}' {limits}> {shown}</label>"


def moving_pictures() -> str:
    """The page."""
    directions, e = edge_directions(), chord_curves()
    tilt, spread, noise, sigma, chord = TILTS.index(45), SPREADS.index(30), NOISES.index(0.05), 0, 9
    said = f"{e[sigma, chord]:.2f} mm"
    data = {
        "tilts": TILTS,
        "spreads": SPREADS,
        "noises": NOISES,
        "directions": np.round(directions, 6).tolist(),
        "sigmas": SIGMAS.tolist(),
        "chords": CHORDS.tolist(),
        "e": np.round(e, 4).tolist(),
        "weak": WEAK,
        "height": HEIGHT,
        "bottom": BOTTOM,
    }
    return f"""# Pictures that move

Computed for every position of the sliders when this site was built. Without a script they stand still, at the papers'
settings.

## An edge: what the motion determines

The scanner moves along arcs over a straight edge, 25 orientations with 10 positions each, as in the edge paper. The
bars are the standard deviations of the joint solution in the six directions of the sensor's pose, worst first, over a
mount measured by hand ({BY_HAND_MM:g} mm, {BY_HAND_DEG:g}°), on a logarithmic scale from 0.0001 to 10; medians of
{SCENES} scenes.

<div class="moving" id="edge">
{slider("tilt", "angle between the arc's plane and the edge", TILTS, tilt, "°")}
{slider("spread", "the flange turns by up to", SPREADS, spread, "°")}
{slider("noise", "noise of the scanner", NOISES, noise, " mm")}
{bars(directions[tilt, spread] * NOISES[noise])}
</div>

How little the spread has to be before the worst direction is lost is the story of
[what motions can determine](notebooks/41_what_motions_can_determine.ipynb).

## A disk: noise and chords

The disk paper's Fig. 15: the error of the disk's centre over the number of chords of each scan, {TRIALS} calibrations
for each point.

<div class="moving" id="disk">
{slider("sigma", "noise of the tips along the chord", SIGMAS, sigma, " mm")}
{slider("chord", "chords of each scan", CHORDS, chord, "")}
{curves(e, sigma)}
<p>The centre's error: <output id="found">{said}</output></p>
</div>

[Notebook 22](notebooks/22_disk_noise.ipynb) has it at the published size, with the four values that the paper prints.

<script type="application/json" id="moving-data">{json.dumps(data)}</script>
<script>{SCRIPT}</script>
"""


SCRIPT = """
(() => {
  const data = JSON.parse(document.getElementById("moving-data").textContent);
  const get = (id) => document.getElementById(id);
  const at = (id, values, unit) => {
    const k = +get(id).value;
    get(id + "-value").textContent = values[k] + unit;
    return k;
  };
  const floor = data.height - data.bottom;
  const edge = () => {
    const sd = data.directions[at("tilt", data.tilts, "°")][at("spread", data.spreads, "°")];
    const noise = data.noises[at("noise", data.noises, " mm")];
    document.querySelectorAll("#edge .bar").forEach((bar, k) => {
      const value = sd[k] * noise;
      const y = Math.min(floor, Math.max(2, floor * (1 - Math.log10(value)) / 5));
      bar.setAttribute("y", y);
      bar.setAttribute("height", floor - y);
      bar.setAttribute("fill", value < data.weak ? "#009E73" : value < 1 ? "#E69F00" : "#D55E00");
    });
  };
  const disk = () => {
    const i = at("sigma", data.sigmas, " mm"), j = at("chord", data.chords, "");
    document.querySelectorAll("#disk .curve").forEach((curve, k) => {
      curve.setAttribute("stroke", k === i ? "#0072B2" : "#bbb");
      curve.setAttribute("stroke-width", k === i ? 4 : 1);
    });
    get("found").textContent = data.e[i][j].toFixed(2) + " mm";
  };
  for (const [names, draw] of [[["tilt", "spread", "noise"], edge], [["sigma", "chord"], disk]]) {
    for (const name of names) get(name).addEventListener("input", draw);
  }
})();
"""
