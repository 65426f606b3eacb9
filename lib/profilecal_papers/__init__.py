"""What the two papers printed, their simulations, and the verdict on both.

In come the tables in data/published and settings that the papers leave open; out go
errors of simulated calibrations, in the papers' own measures, and each printed number
beside ours (`comparison`). Only notebooks use it.
"""
