"""A scan from files that people have: tables of any kind, robots' programs, arrays.

In: a folder, what was scanned, and what the user says of the files (`Layout`).
Out: a `Scan`, and every guess in a line of words. `reading` makes tables of the files,
one module a structure; `makers` holds the words that robots' makers use.
"""
