"""Notebooks as programs, their figures, and what they hand out.

In come notebooks and parameters; out go executed notebooks and what is gathered from
them: figures, the scorecard, a table. papermill executes each in a kernel of its own;
Dask spreads many over cores or a cluster. Papers and tool stand on it.
"""
