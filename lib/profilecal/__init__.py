"""Hand-eye calibration of 2D laser profile scanners on robots."""
