"""Readers of robot descriptions: URDF, xacro, MJCF, Denavit-Hartenberg parameters."""
