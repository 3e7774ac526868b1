"""Identification of a pendulum in Bullet with and without the signs of its torque."""
