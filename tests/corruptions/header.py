"""A scan.toml that says what is not so, or what nobody can read."""

from corruptions.folder import SLIGHT, any_size, corruption
from profilecal.scan.toml import toml_text

NASTY = (
    *(0, -1, 1e-300, 1e308, 1e400, float("nan"), -0.0, True, "", "edge", "50", [], [1.0], {}, 10**400, 1, 25.0, 3000.0),
    *("é" * 3000, "m", "mm", "eye-to-hand", [[[1]]]),
)


@corruption
def entry_replaced(rng, folder):
    header = folder.header()
    section = (
        header
        if rng.uniform() < 0.4
        else header[str(rng.choice([k for k, v in header.items() if isinstance(v, dict)]))]
    )
    section[str(rng.choice(list(section)))] = NASTY[rng.integers(len(NASTY))]
    put_nasty(folder, header)


@corruption
def entry_added(rng, folder):
    header = folder.header()
    where, name = [
        *(("noise", n) for n in ("position_mm", "orientation_deg", "group_position_mm", "steering_mm", "profile_mm")),
        *(("target", n) for n in ("side", "radius", "kind", "size")),
        *(("", n) for n in ("title", "units", "mount", "comment")),
    ][rng.integers(13)]
    (header.setdefault(where, {}) if where else header)[name] = NASTY[rng.integers(len(NASTY))]
    put_nasty(folder, header)


def put_nasty(folder, header):
    text = toml_text(header).replace("Infinity", "inf").replace("NaN", "nan")
    folder.files["scan.toml"] = text.encode()


@corruption
def entry_missing(rng, folder):
    header = folder.header()
    section = header["target"] if rng.uniform() < 0.3 else header
    del section[str(rng.choice(list(section)))]
    folder.put_header(header)


@corruption
def other_kind(rng, folder):
    header = folder.header()
    kind = str(rng.choice(["edge", "disk", "ball", "plane", "point"]))
    header["target"] = {"kind": kind} | ({"radius": float(rng.uniform(10, 80))} if kind in ("disk", "ball") else {})
    folder.put_header(header)


@corruption
def other_radius(rng, folder):
    header = folder.header()
    if "radius" in header["target"]:
        header["target"]["radius"] *= [1000, 0.001, 2, 0.5, 25.4, 1 + any_size(rng, SLIGHT, 0.5)][rng.integers(6)]
    else:
        header["target"]["radius"] = 50.0
    folder.put_header(header)


@corruption
def other_units(rng, folder):
    header = folder.header()
    header["units"] = "m"
    if rng.uniform() < 0.5 and "radius" in header["target"]:
        header["target"]["radius"] /= 1000
    folder.put_header(header)


@corruption
def other_mount(rng, folder):
    header = folder.header()
    header["mount"] = "eye-to-hand"
    folder.put_header(header)


@corruption
def nested_deeply(rng, folder):
    folder.files["scan.toml"] += b"\ndeep = " + b"[" * 20_000 + b"]" * 20_000
