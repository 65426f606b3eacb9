"""The papers' methods: the sensor pose from one target in closed form, rotation first,
then translation.

In come flange poses and what the scanner saw of an edge, a disk, a ball or a mark; out
goes the sensor pose on the flange, with the quantities that the papers name. `edge`,
`disk` and `ball` have a function each for one measurement, `solve_edge` and so on,
which refuses poses that leave the answer open; their equations take batches and refuse
none.
"""
