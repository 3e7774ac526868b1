"""Blind benchmark of diagnosis: robots with concealed faults, and evaluation of the findings."""
