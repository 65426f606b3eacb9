"""The words of robots' and scanners' makers: in names of files, titles and programs."""

import re
from math import degrees

from profilecal.scan.conventions import named

# what names of files have that hold poses
POSE_FILES = re.compile(
    r"pose|(\b|_)posi?(\b|_|\d|ti)|(\b|_)rob|flange|tcp|位姿|机器人|ロボット|로봇|робот|\.rob$",
    re.IGNORECASE,
)
PROGRAM = re.compile(
    r"\.(dat|src|sub|mod|sys|script|urscript|jbi|as|dtx|pgx|prg|mb4|pts|pcs|py|ls|va|pdl|"
    r"lua)$",
    re.IGNORECASE,
)

# columns that tell poses or profiles apart, the first of them that is there
WORDS = (
    "pose name label id index file n nr no frame messung posa misura mesure medida "
    "pomiar номер 序号 编号 番号 번호"
)
LABELS = WORDS.split()

# columns that tell scanners apart
SCANNERS = (
    "sensor scanner camera cam head device source kanal channel kamera kopf laser "
    "gerät profiler capteur appareil sensore dispositivo 传感器 相机 探头 センサ ヘッド"
)
SCANNERS = {*SCANNERS.split()}

# columns that say when
TIMES = re.compile(r"^t$|time|stamp|date|zeit|datum|时间|時刻")

VECTOR = named("rotation vector").columns


def renamed(pairs: str) -> dict[str, str]:
    """Names by other names: "q1=qw q2=qx"."""
    return dict(pair.split("=") for pair in pairs.split())


# other names of our columns; the last are of Universal Robots' real-time data
ALIASES = renamed(
    "q1=qw q2=qx q3=qy q4=qz tx=x ty=y tz=z px=x py=y pz=z roll=w pitch=p yaw=r "
    "ut=tool tool_no=tool uf=base uframe=base base_no=base basis=base fatherid=base "
    "actual_tcp_pose_0=x actual_tcp_pose_1=y actual_tcp_pose_2=z "
    "actual_tcp_pose_3=rx actual_tcp_pose_4=ry actual_tcp_pose_5=rz "
    "tcp_offset_0=tcp_offset_x tcp_offset_1=tcp_offset_y tcp_offset_2=tcp_offset_z "
    "tcp_offset_3=tcp_offset_rx tcp_offset_4=tcp_offset_ry tcp_offset_5=tcp_offset_rz"
)
# what the names of numbers are in files with a word: Stäubli's, Epson's
DIALECTS = {
    "VAL3": renamed("rx=alpha ry=beta rz=gamma"),
    "nNumberOfPoints": renamed("rx=x ry=y rz=z ru=a rv=b rw=c nlocal=base"),
}

# what a profile's columns are called beside x and z
WORDS = (
    "height depth distance höhe abstand hauteur quota altezza altura wysokość výška "
    "высота 高度 深度 距离 高さ 距離 높이"
)
HEIGHTS = WORDS.split()
ALIASES |= dict.fromkeys(HEIGHTS, "z")

# an axis and a word in one
AXIS = re.compile(r"^([xyz])_?(?:coord|pos|val|axis|data)[a-z]*$")

# where x begins and how far apart points are, in lines above a table without x
ONE = r"[^\d\n]*?([+-]?[\d.]+(?:e[+-]?\d+)?)"
X = r"\bx[\W軸轴]*"
X_START = re.compile(X + "(?:start|first|min|offset|origin|始点|起点|開始)" + ONE, re.I)
X_PITCH = re.compile(
    rf"(?:{X}|profile |data |point |^\W*)"
    "(?:pitch|step|interval|spacing|resolution|间距|ピッチ)" + ONE,
    re.I | re.M,
)

# a line above one of several profiles in a file
HEADING = re.compile(r"\W*(?:profile?|scan|frame|轮廓|プロファイル)\W*\d+\W*", re.I)

# numbers that stand for nothing seen
CODE = re.compile(r"-?(?:9+(?:\.9+)?|327\d\d|21474836\d\d)")

# units of length, mm; a table's lengths may be parts of these: 0.01 um
LENGTHS = {
    unit: float(mm)
    for unit, mm in renamed(
        "mm=1 cm=10 m=1000 um=1e-3 µm=1e-3 μm=1e-3 micron=1e-3 nm=1e-6 inch=25.4 "
        "in=25.4"
    ).items()
}

# units by other names
UNITS = renamed(
    "°=deg degree=deg degrees=deg degrés=deg grad=deg gradi=deg grados=deg "
    "град=deg 度=deg мм=mm 毫米=mm"
)

# encodings of text that is not UTF-8, and words and signs that tell which it is
ENCODINGS = ["cp1252", "gb18030", "cp932", "big5", "cp949", "cp1251"]
FOREIGN = ["µ", "坐标", "座標", "位姿", "좌표"]
FOREIGN += [word for word in (*LABELS, *HEIGHTS, *UNITS) if not word.isascii()]

# units of angles in degrees; of what are no angles but vectors
ANGLES = {"": 1.0, "deg": 1.0, "rad": degrees(1), "mrad": degrees(0.001)}
OTHER_ANGLES = {"": 1.0, "1": 1.0, "rad": 1.0, "mrad": 0.001}

AXES = "j1,j2,j3,j4,j5,j6"

# what several numbers behind one name are, by the name and how many there are
POSITION = r"t|p|tvec|trans(lation)?|pos(ition)?|xyz"
ROTATION = r"r|q|rot(ation)?|ori(entation)?|quat(ernion)?|rmat|rpy|euler(_angles)?"
VECTORS = r"r(ot)?_?vec(tor)?"
SEVERAL = {
    6: {r".*joint.*": AXES.split(",")},
    3: {
        rf"(?:{POSITION})(_?vec(tor)?)?": "xyz",
        VECTORS: VECTOR,
    },
    4: {
        r".*wxyz": ("qw", "qx", "qy", "qz"),
        rf"{ROTATION}|.*xyzw": ("qx", "qy", "qz", "qw"),
    },
    9: {rf"(?:{ROTATION})(_?mat(rix)?)?": named("matrix").columns},
}

# what a pose's numbers are if they have no names, by how many there are; TUM's first
MATRIX = "r11,r12,r13,x,r21,r22,r23,y,r31,r32,r33,z"
UNNAMED = {8: "timestamp,x,y,z,qx,qy,qz,qw", 12: MATRIX, 16: MATRIX + ",_,_,_,_"}

# which of several poses is the robot's
OF_ROBOT = re.compile(r"robot|effector|\bee\b|_ee|tcp|flange|gripper|hand|arm")

# names of the inverse of the robot's pose: OpenCV's, and those of the base in a frame
INVERSE = re.compile(
    r"base_?2_?[a-z]|[a-z0-9]_t_(robot_)?base|base_in_[a-z]|"
    r"(\b|_)t_(flange|gripper|tcp|tool0?|ee|hand)_(robot_)?base"
)

# the frames that poses are of: Franka's, others'
TOOL_FRAME = re.compile(
    r"f_t_n?ee|(?:tool|tcp)[_.]?(?:offset|frame|data)|"
    r"(?:flange|effector|hand|tool0)_?(?:t_|to_|2_?|in_)?(?:tool|tcp|ee)\b"
)
TOOL_OFFSET = re.compile(r"(?:tool |(?:tool|tcp)_?offset_)(\w+)")

# what any text says of the tool, in a line of its own or in JSON; but no address
TOOL_WORDS = (
    r"(?:active|current|robot|act|u)?[ _]?(?:tool|tcp|werkzeug|wkz|greifer|"
    r"end[ _-]?effe[ck]tor|outil|utensile|herramienta|инструмент|工具|ツール|툴|child)"
    r"(?:[ _.-]*(?:nr|no|n°|num|number|nummer|id|name|frame|data|index|offset|"
    r"coordinates?|active|aktiv|attivo|actif|号|番号|坐标系?|座標系?|번호))*\.?"
)
TOOL_VALUE = r"(?!\d+\.\d+\.\d)([\w$][^\n;,|\t\"'\[\]{}]*|[-+\d.][-+\d.eE,; \t]*)"
TOOL_SAID = re.compile(
    rf"^[^\w\n]*{TOOL_WORDS}[\"']?[ \t]*(?:[:：=;,|\t]|is\b)[\s\"'\[({{]*{TOOL_VALUE}"
    rf"[\"'\])}}]*[\s,;|]*$|\"{TOOL_WORDS}\"\s*:[\s\"\[]*{TOOL_VALUE}|"
    rf"^[ \t]*[#%;/]+[ \t]*{TOOL_WORDS}[ \t]+(?!pos|coord|cent)([a-z]\w*)[ \t\r]*$|"
    rf"(?<![a-z]){TOOL_WORDS}(?<!tcp)(?<!tcp.)[ _:：=#-]*[\[(]?"
    r"([-\d., ]*[1-9][-\d., ]*)|\btcp(?:[ :=]*[\[(]([-\d., ]*[1-9][-\d., ]*)|[ _]?(\d+)"
    rf"(?=[ _.][xyz]\b))|(?<![a-z]){TOOL_WORDS}[ \t]*:?[:：=][ \t]*([a-z]\w*)|"
    r"\btf2?_echo[ \t]+\S+[ \t]+(\S+)",
    re.IGNORECASE | re.MULTILINE,
)

# and of the base, in a line of its own
BASE_SAID = re.compile(
    r"^[^\w\n]*(?:user[ _-]?(?:frame|coord\w*)|work[ _-]?object|base[ _-]?(?:frame|no)|"
    r"u(?:ser)?frame|用户坐标系|工件坐标系)[ _]?(?:nr|no|number)?\.?[ \t]*[:：=]"
    rf"[ \t\"']*{TOOL_VALUE}[\"']?[ \t,;\r]*$",
    re.IGNORECASE | re.MULTILINE,
)

# axes that are no pose
JOINTS = re.compile(r"(?:j|a|q|joint|axis|theta|pulse)_?([1-6])")

# what the numbers of a list are in a robot's language, by what stands before it, or by
# how many there are: ABB, Universal Robots, Denso, Doosan, Comau, Kawasaki, Mitsubishi,
# Techman, xArm, Mecademic
LISTS = {
    "tooldata": "_,x,y,z,qw,qx,qy,qz,_,_,_,_,_,_,_,_,_,_,_",
    "wobjdata": "_,_,_,x,y,z,qw,qx,qy,qz,object x,object y,object z,"
    "object qw,object qx,object qy,object qz",
    "p": "x,y,z,rx [1],ry [1],rz [1]",
    "pos": "x,y,z,o,a,t,_",
    # below a line that says so: Yaskawa
    "pulse": "pulse_1,pulse_2,pulse_3,pulse_4,pulse_5,pulse_6",
}
# by what they are; rectan and joints, too, below a line that says so
for words, columns in {
    "robtarget [": "x,y,z,qw,qx,qy,qz,_,_,_,_,_,_,_,_,_,_",
    "jointtarget moveabsj": "j1,j2,j3,j4,j5,j6,_,_,_,_,_,_",
    "p( ( c_list set_position set_tcp_offset rectan": "x,y,z,w,p,r",
    "posx trans": "x,y,z,o,a,t",
    "movelin movepose settrf": "x,y,z,alpha,beta,gamma",
    "movej posj j( j_list set_servo_angle movejoints joints": AXES,
}.items():
    LISTS |= dict.fromkeys(words.split(), columns)
# calls of Techman's and xArm's that have one of these lists, and how it is written here
CALLS = {
    r'\w+\("([CJ])[PA][PR]",\s*': r"\1_list(",
    r"\.(set_\w+)\((?:\w+=|\*)?(?=\[)": r" \1",
    r"\.(?=set_\w+\()": " ",
    r"(?<=ChangeTCP\()(?=[-+\d.]+,)": "C_list(",
    r"\{(?=[\s{]*[-+\d.])": "[",
    r"(?<=[\d\]}])\}": "]",
}
# FANUC's system variables by what other listings call their elements
VARIABLES = {"mnutool": "tool_data", "mnuframe": "base_data"}
# remarks, by words of the language that has them
REMARKS = {
    "": r"^[ \t]*(?:[#%]|//[ \t]).*",
    r"\b(?:robtarget|tooldata)\b|^ *module\b": r"!.*",
    r"\bp\[ *-?[\d.]+ *,": r"#.*",
    r"^&access|^defdat|^def |\{x |^\.(?:trans|program)": r";.*",
    r"^/job|^\d* *(?:mov|mvs|def pos)\b": r"'.*",
    r"<\w+ ": r"(?s:<!--.*?(?:-->|\Z))",
    r"^/prog": r"^ *\d*: *!.*",
}

# the frames that poses are in and of: what sets them, which names stand for none, and
# what a frame is called that is no pose; and external axes
FRAME_SET = {
    "tool": r"(?:(?=set_tcp_offset|settrf)|(?:set|change)_?(?:tcp|tool)\w*\(|"
    r"^[ \t/\d]*(?:change)?tool[ \t]+|\$tool *:?=|#tool,|m_tool *=)[ \t\"']*(\S.*)",
    "base": r"(?:^[ \t/]*(?:base|user|changework)[ \t]+|changebase\(|\$base *:?=|"
    r"#base,)[ \t\"']*(\S.*)",
}
MOVE = r"\bmove[ljc]\w*\s+([^;\n]*?)\s*,\s*(\w+)\s*(?:\\wobj:=(\w+)[^;\n]*)?(?:;|$)"
# Nachi's and Hyundai's
NUMBERED_TOOL = r"^[ \t\w]*\bmovex?[ \t][^\n]*[ ,](?:h|t|tool)=(\d+)"
# VAL3: an array's point, or any of its points
CALL = (
    r"\bmove[ljc]\(\s*([a-z]\w*(?:\[\d+\])?)(?:\[\D.*?\])?\s*,"
    r"\s*([a-z]\w*)(?:\[0\])?\s*,"
)
NO_FRAME = (
    "0 tool0 wobj0 flange flange0 world world0 null nullframe $nullframe p_ntool "
    "p_nbase notool robotbase none ee_link wrist_3_link link6 link_6 link7 panda_link8"
)
NO_FRAME = {"", *NO_FRAME.split()}
IS_FRAME = r"\$?(?:{0})(?:_?data)?\d*|set_tcp_offset|settrf"
FRAMES = {"base": "base or user frame", "tool": "tool"}
UNSAID = "a tool"  # whose frame a program has, without a word that poses are of it
EXTERNAL = re.compile(r"e\d|gp\d .*")


def several(name: str, count: int) -> tuple[str, ...]:
    """What `count` numbers behind one name are; nothing where that is not known."""
    known = SEVERAL.get(count, {}).items()
    fitting = (columns for words, columns in known if re.fullmatch(words, name))
    return next(fitting, ())
