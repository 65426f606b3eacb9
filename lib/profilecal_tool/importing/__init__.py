"""A scan from files that people have.

In: a folder, what was scanned, and what is said of the files (`questions.Layout`).
Out: a `Scan`, and what was taken for granted; or a `Question` with its answer.

`read_file` makes tables (`Block`) of any file: `text_tables`, `program_lines`,
`nested_lists`, `array_files`. `column_meanings` says, by titles and by makers.toml,
what their columns are; `robot_poses` and `scanner_profiles` take the numbers,
`pair_profiles` tells which belong together, `tool_frames` takes the tool off, and
`import_scan` makes the scan.
"""
