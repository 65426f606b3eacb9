"""A user's measurements as a `Scan`: poses of the flange, what the scanner saw from each, and what is known beside.

In come scan folders (data/README.md) and the measurements of another project; out go Scans in mm, or a ScanError that
names file, line, value and what was expected. The room also writes scan folders, and knows how robot controllers write
a pose.
"""
