"""Files whose bytes or lines are lost, doubled or written as other programs write them;
what scan.toml says.
"""

from functools import wraps

from corruptions.folder import SLIGHT, any_size, corruption, one, some
from profilecal.scan.toml import toml_text


def on_bytes(function):
    """A corruption of the content of any file, or of any table's."""

    @wraps(function)
    def change(rng, folder):
        names = [name for name in sorted(folder.files) if name != "truth.toml"]
        name = str(rng.choice(names))
        folder.files[name] = bytes(function(rng, folder.files[name]))

    return corruption(change)


@on_bytes
def bytes_flipped(rng, content):
    content, digits = bytearray(content), b"0123456789.-,"
    places = (
        [i for i, c in enumerate(content) if c in digits]
        if rng.uniform() < 0.5
        else range(len(content))
    )
    for i in some(rng, len(places), 1, 30):
        content[places[i]] = (
            rng.choice(list(digits + b"e"))
            if len(places) < len(content)
            else rng.integers(256)
        )
    return content


@on_bytes
def lines_lost_or_doubled(rng, content):
    lines, times = content.splitlines(keepends=True), int(rng.choice([0, 2]))
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
def other_encoding(rng, content):
    text = (
        content.decode("utf-8", "replace")
        .replace("g1p1", "g1ä1")
        .replace("Simulated", "Prüfkörper")
    )
    return text.encode(
        str(rng.choice(["utf-8-sig", "utf-16", "utf-16-le", "latin-1", "cp500"])),
        "replace",
    )


@on_bytes
def something_inserted(rng, content):
    nasty = [
        b'"',
        b"\0",
        b"\x1a",
        b",",
        b"#",
        b"\r",
        b"\n",
        b"nan",
        b"\xff",
        b"-",
        b"e",
        b"[",
        b"1e999",
        b"1_0",
    ]
    for i in sorted(some(rng, len(content), 1, 5).tolist(), reverse=True):
        content = content[:i] + one(rng, nasty) + content[i:]
    return content


NASTY = (
    *(
        0,
        -1,
        1e-300,
        1e308,
        1e400,
        float("nan"),
        -0.0,
        True,
        "",
        "edge",
        "50",
        [],
        [1.0],
        {},
        10**400,
        1,
        25.0,
        3000.0,
    ),
    *("é" * 3000, "m", "mm", "eye-to-hand", [[[1]]]),
)
ENTRIES = [
    *(
        ("noise", n)
        for n in (
            "position_mm",
            "orientation_deg",
            "group_position_mm",
            "steering_mm",
            "profile_mm",
        )
    ),
    *(("target", n) for n in ("side", "radius", "kind", "size")),
    *(("", n) for n in ("title", "units", "mount", "comment")),
]


@corruption
def entry_set_to_anything(rng, folder):
    header, (where, name) = folder.header(), one(rng, ENTRIES)
    (header.setdefault(where, {}) if where else header)[name] = one(rng, NASTY)
    folder.files["scan.toml"] = (
        toml_text(header).replace("Infinity", "inf").replace("NaN", "nan").encode()
    )


@corruption
def other_radius(rng, folder):
    header = folder.header()
    if "radius" in header["target"]:
        header["target"]["radius"] *= one(
            rng, [1000, 0.001, 2, 0.5, 25.4, 1 + any_size(rng, SLIGHT, 0.5)]
        )
    else:
        header["target"]["radius"] = 50.0
    folder.put_header(header)


@corruption
def other_units_or_mount(rng, folder):
    header = folder.header()
    header |= one(rng, [{"units": "m"}, {"mount": "eye-to-hand"}])
    if header["units"] == "m" and rng.uniform() < 0.5 and "radius" in header["target"]:
        header["target"]["radius"] /= 1000
    folder.put_header(header)
