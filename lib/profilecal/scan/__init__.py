"""A user's measurements as a `Scan`: poses of the flange, and what the scanner saw from
each.

In come scan folders (data/README.md) and the files of other projects; out go Scans in
mm, or a ScanError that names file, line, value and what was expected. The room also
writes scan folders, and poses as robot controllers do.

In reading order: `tables` and `toml` read files of any content, `conventions` says how
orientations are written; `scan` is the scan in memory, and `folder` puts it into files
and back.
"""
