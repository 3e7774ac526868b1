"""Observations for sign recovery, and their segments of constant sign."""
