"""A scan from files that people have: tables of any kind, robots' programs, arrays.

In: a folder, what was scanned, and what the user says of the files (`Layout`).
Out: a `Scan`, and every guess in a line of words.

Each structure has a reader in a module of its own: `programs`, `key_value`, `nested`,
`tables`, `arrays`. The words that robots' makers use stand in one place, `makers`.
`poses` and `profiles` say what the numbers mean, `import_scan` makes the scan of them.
"""
