"""Files whose bytes or lines are lost, doubled, exchanged or written as other programs write them."""

from corruptions.folder import any_file, any_table, corruption, some


@corruption
def bytes_flipped(rng, folder):
    name = any_file(rng, folder)
    content = bytearray(folder.files[name])
    for i in some(rng, len(content), 1, 30):
        content[i] = rng.integers(256)
    folder.files[name] = bytes(content)


@corruption
def digits_flipped(rng, folder):
    name = any_file(rng, folder)
    content = bytearray(folder.files[name])
    digits = [i for i, c in enumerate(content) if c in b"0123456789.-,"]
    for i in some(rng, len(digits), 1, 30):
        content[digits[i]] = rng.choice(list(b"0123456789.-,e"))
    folder.files[name] = bytes(content)


@corruption
def lines_deleted(rng, folder):
    name = any_file(rng, folder)
    lines = folder.files[name].splitlines(keepends=True)
    gone = set(some(rng, len(lines)).tolist())
    folder.files[name] = b"".join(line for i, line in enumerate(lines) if i not in gone)


@corruption
def lines_doubled(rng, folder):
    name = any_file(rng, folder)
    lines = folder.files[name].splitlines(keepends=True)
    twice = set(some(rng, len(lines)).tolist())
    folder.files[name] = b"".join(line * (1 + (i in twice)) for i, line in enumerate(lines))


@corruption
def lines_exchanged(rng, folder):
    name = any_file(rng, folder)
    lines = folder.files[name].splitlines(keepends=True)
    for _ in range(rng.integers(1, 10)):
        i, j = rng.integers(len(lines), size=2)
        lines[i], lines[j] = lines[j], lines[i]
    folder.files[name] = b"".join(lines)


@corruption
def cut_short(rng, folder):
    name = any_file(rng, folder)
    folder.files[name] = folder.files[name][: rng.integers(len(folder.files[name]))]


@corruption
def other_delimiter(rng, folder):
    name = f"{any_table(rng)}.csv"
    folder.files[name] = folder.files[name].replace(b",", [b";", b"\t", b" ", b", "][rng.integers(4)])


@corruption
def decimal_commas(rng, folder):
    name = f"{any_table(rng)}.csv"
    content = folder.files[name]
    if rng.uniform() < 0.5:
        content = content.replace(b",", b";")
    folder.files[name] = content.replace(b".", b",")


@corruption
def other_encoding(rng, folder):
    name = any_file(rng, folder)
    text = folder.files[name].decode("utf-8", "replace").replace("g1p1", "g1ä1").replace("Simulated", "Prüfkörper")
    folder.files[name] = text.encode(
        str(rng.choice(["utf-8-sig", "utf-16", "utf-16-le", "latin-1", "cp500"])), "replace"
    )


@corruption
def other_line_ends(rng, folder):
    name = any_file(rng, folder)
    folder.files[name] = folder.files[name].replace(b"\n", [b"\r\n", b"\r", b"\n\n", b"\n\r"][rng.integers(4)])


@corruption
def something_inserted(rng, folder):
    name = any_file(rng, folder)
    content = folder.files[name]
    for i in sorted(some(rng, len(content), 1, 5).tolist(), reverse=True):
        nasty = [b'"', b"'", b"\0", b"\x1a", b",", b"#", b"\n", b"nan", b"\xff", b"-", b"e", b"[", b"1e999", b'""']
        content = content[:i] + nasty[rng.integers(len(nasty))] + content[i:]
    folder.files[name] = content


@corruption
def file_emptied(rng, folder):
    name = any_file(rng, folder)
    folder.files[name] = [b"", b"\n", b" ", folder.files[name].split(b"\n")[0] + b"\n"][rng.integers(4)]


@corruption
def file_missing(rng, folder):
    del folder.files[any_file(rng, folder)]


@corruption
def files_exchanged(rng, folder):
    a, b = rng.choice(["poses.csv", "profiles.csv", "scan.toml"], 2, replace=False)
    folder.files[a], folder.files[b] = folder.files[b], folder.files[a]


@corruption
def number_rewritten(rng, folder):
    """One line's numbers as another program prints them."""
    name = f"{any_table(rng)}.csv"
    lines = folder.files[name].decode().split("\n")
    i = int(rng.integers(1, len(lines)))
    old = rng.choice(list("0123456789.,"))
    lines[i] = lines[i].replace(
        old, str(rng.choice(["1'000", "1 0", "O", "l", "٣", "½", "0x1F", "1_0", "True", " mm", "°"]))
    )
    folder.files[name] = "\n".join(lines).encode()
