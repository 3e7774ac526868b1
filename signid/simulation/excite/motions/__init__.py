"""Families of periodic motions, and random members of them."""
