"""The papers' solvers, equation by equation, with the papers' symbols: edge (Xu et al. 2021); disk, ball, tetra-ball
(Chen et al. 2018).

In: flange poses and what the sensor saw, as the papers have it. Out: the sensor pose with every quantity on the way;
or, by `solve`, one scan's answer stated as a joint solution is.
"""
