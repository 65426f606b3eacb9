"""The words of robots' and scanners' makers: in names of files, titles and programs."""

import re

from profilecal.scan.conventions import named

# what names of files have that hold poses
POSE_FILES = re.compile(
    r"pose|(\b|_)rob|flange|tcp|\.(ls|dat|mod|script|rob)$", re.IGNORECASE
)

# columns that tell poses or profiles apart, the first of them that is there
LABELS = ("pose", "name", "label", "id", "index", "file", "n")

# other names of our columns
ALIASES = {
    "q1": "qw",
    "q2": "qx",
    "q3": "qy",
    "q4": "qz",
    "tx": "x",
    "ty": "y",
    "tz": "z",
    "px": "x",
    "py": "y",
    "pz": "z",
}

# what several numbers behind one name are, by the name and how many there are
SEVERAL = {("t", 3): ("x", "y", "z"), ("r", 9): named("matrix").columns}

# what a pose's numbers are if they have no names, by how many there are; TUM's first
MATRIX = "r11,r12,r13,x,r21,r22,r23,y,r31,r32,r33,z"
UNNAMED = {8: "timestamp,x,y,z,qx,qy,qz,qw", 12: MATRIX, 16: f"{MATRIX},_,_,_,_"}

# the frames that FANUC's poses are in and of; and these with its external axes
FRAMES = {"uf": "user frame", "ut": "tool"}
FRAMES_AND_AXES = re.compile(r"uf|ut|e\d|gp\d .*")
