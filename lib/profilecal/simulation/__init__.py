"""Measurements that were never made: random scenes and sweeps, robots with pose
errors, scanners with noise.

In: a target's kind, a plan, a noise, a random generator; or a specification. Out:
observations for noise studies with the truth behind them; or a `Scan`, as a folder
would hold it.
"""
