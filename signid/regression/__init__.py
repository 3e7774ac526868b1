"""Recordings and robot -> filtered rows of the regressor and torque, base parameters, additive factors."""
