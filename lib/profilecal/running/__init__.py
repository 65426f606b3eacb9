"""Notebooks as programs: one of them on a user's scan, all of them, or one over a grid of parameters.

In come notebooks and parameters; out go executed notebooks and what is gathered from them: a report, the scorecard, a
table. papermill executes each in a kernel of its own; Dask spreads many over cores or a cluster.
"""
