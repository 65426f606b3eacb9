"""What a target looks like in raw profiles, and how well that is known, whatever the
target.

A profile is (n, 2), x and z in mm, as scanners give it: with gaps, spikes, missing
points (NaN, depth zero or left out), backgrounds, the depth axis pointing either way.
A target's `find` hands its finder the points that were seen, x rising but for folds at
steep faces. In come a scan's profiles; out go a `Feature` for each, with its covariance
or, where the target is not clear, a reason in words: a missing observation costs
little, a wrong one much. Finders of edges, chords and faces rest on straight runs
(`runs`) and where they end (`ends`), and choose among `candidates`; those of balls and
rods (`arcs`) rest on circles and ellipses. A target's class names its finder.
"""
