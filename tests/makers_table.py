"""The part of data/README.md that is made from makers.toml. To write it anew:
python tests/makers_table.py
"""

from pathlib import Path

from profilecal_tool.importing.makers import ROBOTS

README = Path(__file__).parents[1] / "data" / "README.md"
BEGIN, END = "<!-- table of makers -->\n", "<!-- end of the table -->\n"


def table():
    """A row for each robot, with its example."""
    lines = ["| robot | a line of its file |", "| --- | --- |"]
    for maker, robot in ROBOTS.items():
        example = robot.pose[0][1].replace("|", "\\|")
        lines.append(f"| {maker} | `{example}` |")
    return "\n".join([*lines, ""])


def with_table():
    """The page, with the table as it should be."""
    before, rest = README.read_text(encoding="utf-8").split(BEGIN)
    return before + BEGIN + table() + END + rest.split(END)[1]


if __name__ == "__main__":
    README.write_text(with_table(), encoding="utf-8")
