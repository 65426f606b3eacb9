"""Notebooks as programs: one of them on a user's scan, all of them, or one over a grid of parameters.

In come notebooks and parameters; out go executed notebooks, each whole or not at all, and what is gathered from them: a
report in HTML, the scorecard, a table. Every notebook runs in a process of its own.
"""
