"""Families of motions, and random motions."""
