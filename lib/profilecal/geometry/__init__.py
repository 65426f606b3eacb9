"""What everything else stands on: rotations and rigid transforms, fits of lines,
circles, spheres and ellipses, guards of public entries, standard deviations of a
measurement's errors, what an information matrix determines. Arrays in, arrays out;
leading axes are a batch.
"""
