"""Descriptions of robots -> trees of bodies and joints: URDF, xacro, MJCF, Denavit-Hartenberg."""
