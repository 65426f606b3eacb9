"""The words of robots' and scanners' makers: in names of files, titles and programs."""

import re

from profilecal.scan.conventions import named

# what names of files have that hold poses
POSE_FILES = re.compile(
    r"pose|(\b|_)rob|flange|tcp|位姿|机器人|\.(ls|dat|mod|script|rob)$", re.IGNORECASE
)

# columns that tell poses or profiles apart, the first of them that is there
LABELS = ("pose", "name", "label", "id", "index", "file", "n", "nr", "no")
LABELS += ("frame", "messung", "序号", "编号", "番号")

# columns that tell scanners apart
SCANNERS = {"sensor", "scanner", "camera", "head", "device", "source", "channel"}

# columns that say when, and the name of what `times` reads from them
TIMES = re.compile(r"time|stamp|date|zeit|datum|时间|時刻")

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

# what a profile's columns are called beside x and z
HEIGHTS = ("height", "depth", "distance", "höhe", "abstand", "hauteur")
HEIGHTS += ("高度", "深度", "距离", "高さ", "距離")

# where x begins and how far apart points are, in lines above a table without x
ONE = r"\D*?([+-]?[\d.]+(?:e[+-]?\d+)?)"
X_START = re.compile(r"\bx\W*(?:start|first|min|offset|origin|始点|起点)" + ONE, re.I)
X_PITCH = re.compile(r"(?:pitch|step|interval|spacing|间距|ピッチ)" + ONE, re.I)

# numbers that stand for nothing seen
CODE = re.compile(r"-?(?:9+(?:\.9+)?|327\d\d|21474836\d\d)")

# encodings of text that is not UTF-8, and words and signs that tell which it is
ENCODINGS = ("cp1252", "gb18030", "cp932", "big5", "cp949", "cp1251")
FOREIGN = ("°", "µ", "坐标", "座標", "位姿")
FOREIGN += tuple(word for word in (*LABELS, *HEIGHTS) if not word.isascii())

# units of length, mm
LENGTHS = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "um": 1e-3, "nm": 1e-6, "inch": 25.4}
# a table's lengths may be parts of these: 0.01 um
LENGTHS |= {"µm": 1e-3, "μm": 1e-3, "micron": 1e-3, "in": 25.4, "毫米": 1.0}

# what several numbers behind one name are, by the name and how many there are
SEVERAL = {("t", 3): ("x", "y", "z"), ("r", 9): named("matrix").columns}

# what a pose's numbers are if they have no names, by how many there are; TUM's first
MATRIX = "r11,r12,r13,x,r21,r22,r23,y,r31,r32,r33,z"
UNNAMED = {8: "timestamp,x,y,z,qx,qy,qz,qw", 12: MATRIX, 16: f"{MATRIX},_,_,_,_"}

# the frames that FANUC's poses are in and of; and these with its external axes
FRAMES = {"uf": "user frame", "ut": "tool"}
FRAMES_AND_AXES = re.compile(r"uf|ut|e\d|gp\d .*")
