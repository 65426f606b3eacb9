"""The papers' solvers, equation by equation, with the papers' symbols."""
