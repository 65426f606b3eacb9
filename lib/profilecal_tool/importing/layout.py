"""What a user says of files."""

from dataclasses import dataclass

from profilecal.scan.scan import MOUNTS


@dataclass(frozen=True)
class Layout:
    """What is said of the files; what is empty is guessed."""

    profiles: str = ""  # which files, as a shell pattern
    poses: str = ""  # which file or files
    # names or numbers, from 1, of x and z in a profile: "x,z" or "1 [mm],3 [mm]"
    columns: str = ""
    # what a pose's numbers are, in their order: "x [m],y [m],z [m],a,b,c"; "_" for no
    # meaning
    pose_columns: str = ""
    entry: str = ""  # the list in a YAML or NPZ file that is the profile
    where: str = ""  # the rows of a profile that are taken: "sensor=0"
    x: tuple[float, float] | None = None  # of the first point; from one to the next
    # of the first profile, s by the scanner's clock; and profiles in a second
    times: tuple[float, float] | None = None
    unit: str = ""  # of x and z: "mm", "0.01 um"
    missing: float | None = None  # z where the scanner saw nothing
    encoding: str = ""  # of text that is not UTF-8
    # x, y, z, mm, and three angles of the poses' frame, in the flange's
    tool: tuple[float, ...] | None = None
    mount: str = MOUNTS[0]
    in_one: bool = False  # poses and profiles are in one table


NOTHING_SAID = Layout()
