"""Calibration targets, one file each: where they are, and where the scan plane meets them.

A scan plane is y = 0 of a sensor frame given by `rotation` (..., 3, 3) and `origin` (..., 3) in the base frame, mm.
"""
