"""The command `profilecal`: import, check, calibrate, plan, verify, report, sweep.

It turns files that people have into scans, answers into words and pages, and knows
nothing of the papers. Nothing imports it but notebooks.
"""
