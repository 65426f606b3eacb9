"""Files whose bytes or lines are lost, doubled or written as other programs write them;
what scan.toml says.
"""

from functools import wraps

from corruptions.folder import corruption, one, some
from profilecal.scan.toml import toml_text


def on_bytes(function):
    """A corruption of the content of any file, or of any table's."""

    @wraps(function)
    def change(rng, folder):
        names = [name for name in sorted(folder.files) if name != "truth.toml"]
        name = str(rng.choice(names))
        folder.files[name] = bytes(function(rng, folder.files[name]))

    return corruption(change)


DIGITS = b"0123456789.-,"
SMUGGLED = [
    *(b'"', b"\0", b"\x1a", b",", b"#", b"\r", b"\n"),
    *(b"nan", b"\xff", b"-", b"e", b"[", b"1e999", b"1_0"),
]


@on_bytes
def bytes_flipped(rng, content):
    """In one of two, digits alone become other digits."""
    content = bytearray(content)
    places = range(len(content))
    if rng.uniform() < 0.5:
        places = [i for i, byte in enumerate(content) if byte in DIGITS]
    digits_alone = len(places) < len(content)
    for i in some(rng, len(places), 1, 30):
        if digits_alone:
            content[places[i]] = rng.choice(list(DIGITS + b"e"))
        else:
            content[places[i]] = rng.integers(256)
    return content


@on_bytes
def lines_lost_or_doubled(rng, content):
    lines = content.splitlines(keepends=True)
    times = int(rng.choice([0, 2]))
    chosen = set(some(rng, len(lines)).tolist())
    return b"".join(
        line * (times if i in chosen else 1) for i, line in enumerate(lines)
    )


@on_bytes
def cut_short(rng, content):
    return content[: rng.integers(len(content))]


@on_bytes
def other_separators(rng, content):
    content = content.replace(b",", one(rng, [b";", b"\t", b" ", b", "]))
    return content.replace(b".", b",") if rng.uniform() < 0.5 else content


@on_bytes
def something_inserted(rng, content):
    for i in sorted(some(rng, len(content), 1, 5).tolist(), reverse=True):
        content = content[:i] + one(rng, SMUGGLED) + content[i:]
    return content


NASTY = (
    *(0, -1, 1e-300, 1e308, 1e400, float("nan"), -0.0, True, "", "edge", "50"),
    *([], [1.0], {}, 10**400, 1, 25.0, 3000.0),
    *("é" * 3000, "m", "mm", "eye-to-hand", [[[1]]]),
)
OF_NOISE = (
    *("position_mm", "orientation_deg"),
    *("group_position_mm", "steering_mm", "profile_mm"),
)
# tables and their entries
ENTRIES = [
    *(("noise", name) for name in OF_NOISE),
    *(("target", name) for name in ("side", "radius", "kind", "size")),
    *(("", name) for name in ("title", "units", "mount", "comment")),
]


@corruption
def entry_set_to_anything(rng, folder):
    header = folder.header()
    table, name = one(rng, ENTRIES)
    entries = header.setdefault(table, {}) if table else header
    entries[name] = one(rng, NASTY)
    text = toml_text(header).replace("Infinity", "inf").replace("NaN", "nan")
    folder.files["scan.toml"] = text.encode()


@corruption
def other_units_or_mount(rng, folder):
    header = folder.header()
    header |= one(rng, [{"units": "m"}, {"mount": "eye-to-hand"}])
    if header["units"] == "m" and rng.uniform() < 0.5 and "radius" in header["target"]:
        header["target"]["radius"] /= 1000
    folder.put_header(header)
