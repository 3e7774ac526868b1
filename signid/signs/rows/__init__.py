"""Absolute torque -> segments of constant sign, and the rows that observe them."""
