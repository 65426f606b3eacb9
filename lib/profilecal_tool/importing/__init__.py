"""A scan from files that people have.

In: a folder, what was scanned, and what is said of the files (`questions.Layout`).
Out: a `Scan`, and what was taken for granted; or a `Question` with its answer.

    files ─► blocks ─► columns by what they are ─► poses ────┐
            (`Block`)  (makers.toml)               profiles ─┴─► paired ─► scan

1. `read_file` reads tables of text and sheets, `program_lines` programs, and
   `lists_and_arrays` JSON, YAML, arrays; `makers` says what makers.toml does.
2. `blocks` tells what a column is by its title, and in a list by how many numbers
   there are; what it does not know is asked.
3. `robot_poses` and `scanner_profiles` choose columns of blocks (`Part`) and take their
   numbers, with units. In a table that holds both, a profile has the pose of its first
   row.
4. `pair_profiles` finds the pose of each profile: by label, by time, in order.
5. `tool_frames` takes a tool off; `import_scan` makes the scan.
"""
