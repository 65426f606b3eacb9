"""What can go wrong with a scan folder, by kind: each corruption changes a `Folder` as
a random generator tells it to.

Profiles whose x or z are all negated, or exchanged for each other, are a faultless scan
by a scanner turned by 180° about its z, x, or a diagonal, as the scan plane has no y:
such a corruption carries the pose that it stands for.
"""

from importlib import import_module

from corruptions.folder import CORRUPTIONS, Folder

__all__ = ["CORRUPTIONS", "Folder"]

for part in ("files", "tables", "poses", "profiles"):  # in which seeds count them
    import_module(f"corruptions.{part}")
