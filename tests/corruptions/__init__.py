"""What can go wrong with a scan folder, by kind: each corruption changes a `Folder` as
a random generator tells it to.

Some make a faultless scan of another sensor pose, which no program can tell from a scan
of that sensor. They carry the pose that they stand for:

- the profiles' x or z negated or exchanged for each other, in all of them: as the scan
  plane has no y, that is the scanner turned by 180° about its z, x, or a diagonal;
- poses of a tool instead of the flange: the sensor pose relative to the tool;
- a left-handed robot frame, y and two angles negated: the mirror image of the flange
  and the sensor;
- all lengths in another unit: the sensor pose in that unit;
- the other mount with inverted poses: the same numbers;
- all poses moved by one motion of the base, negated quaternions: no change.
"""

from importlib import import_module

from corruptions.folder import CORRUPTIONS, Folder

__all__ = ["CORRUPTIONS", "Folder"]

for part in ("files", "tables", "poses", "profiles"):  # in which seeds count them
    import_module(f"corruptions.{part}")
