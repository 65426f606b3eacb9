"""A scan from files that people have.

In: a folder, what was scanned, and what is said of the files (`questions.Layout`).
Out: a `Scan`, and what was taken for granted; or a `Question` with its answer.

    files ─► blocks ─► columns by what they are ─► poses ────┐
            (`Block`)  (makers.toml)               profiles ─┴─► paired ─► scan

1. `questions` has what a user says, and what is asked; `makers` says what makers.toml
   does. `blocks` tells what a column is by its title, and in a list by how many numbers
   there are; what it does not know is asked.
2. `folder_files` has the files of a folder, and `read_file` reads each: `text_tables`
   tables of text, `program_lines` programs, `lists_and_arrays` JSON, YAML, arrays.
3. `robot_poses` and `scanner_profiles` choose columns of blocks and take their numbers,
   with units, for points by `points_in_mm`. Before, `heights` makes profiles of a row
   or of two columns each a row for each point. In a table that holds poses and
   profiles, a profile has the pose of its first row.
4. `pair_profiles` finds the pose of each profile: by label, by time, in order.
5. `tool_frames` takes a tool off; `import_scan` makes the scan.

Profiles and poses are left out where `pair_profiles.pairing_of` has no partner for
them (`matched` says so), where their files are of no pattern that is read (`files left
out`), where their rows or their tool are not wanted (`with_rows_wanted`,
`of_one_frame`), and where they are of another entry (`of_one_entry`). Profiles of which
fewer than two points were seen are empty (`points_or_profiles`; `missing` says so).

Words, each for one thing::

    layout   what a user says of the files; `said`, one option of it; `wanted`, the
             column and the value of rows, or the frame, that --where says
    pattern  what files of one kind are called, as scan_*.csv; a family is these files
    block    a table in a file; its columns have a title, a role, such as x or label,
             and an owner, which is tcp in tcp_x
    poses    a block with a pose chosen in each row; points, one with x and z chosen;
             the entry is their name, as --entry says it
    label    what tells a pose from others; name, what a profile or a file is called
    form     what a line of a program looks like; its kind is pose, tool, base, uses
             or beside
    frame    a tool or a base, by its name; numbers, its position and angles
    fields   what a Scan is made of; taken, words on what was taken for granted
"""
