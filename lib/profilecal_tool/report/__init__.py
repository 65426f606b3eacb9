"""A calibration on a page: words, pictures and clouds of points, which notebook 60 puts
together.
"""
