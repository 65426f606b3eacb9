"""A scan from files that people have.

In: a folder, what was scanned, and what is said of the files (`answers.Layout`).
Out: a `Scan`, and what was taken for granted; or a `Question` with its answer.

Any file becomes blocks: `blocks` (text), `programs`, `nested`, `arrays`. `roles` says,
by titles and by makers.toml, what their columns are; `poses` and `profiles` take the
numbers, `pairing` tells which belong together, `import_scan` makes the scan.
"""
