"""What people read: figures of the notebooks, words, tables and pictures of a
calibration.

In come results of the other rooms; out go matplotlib figures, HTML and tables. No other
room imports matplotlib.
"""
