"""The report on a calibration: its words, tables and pictures, on one page.

In come calibrations and plans; out go matplotlib figures and HTML.
"""
