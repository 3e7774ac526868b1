"""Torque whose sign was lost: segments, a search over their signs, and how sure each is."""
