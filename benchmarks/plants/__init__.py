"""Robots in simulators that share no code with signid, to judge it by."""
