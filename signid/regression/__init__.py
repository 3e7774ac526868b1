"""Recordings and a robot -> rows: filter, motion, regressor, base parameters, additive factors."""
