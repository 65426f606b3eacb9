"""What everything else stands on: rotations and rigid transforms, fits of circles,
spheres and ellipses, a robot's log, guards of public entries, standard deviations of a
measurement's errors, what an information matrix determines, progress bars. Arrays in,
arrays out; leading axes are a batch.
"""
