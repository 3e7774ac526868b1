"""Closed loop of drives and robot: recordings on a grid, the robot along them, roll-outs from commands alone."""

from .grid import grids_of_arrays, servo_grid, servo_grids
from .roll_out import roll_out, saturated_share

__all__ = ["grids_of_arrays", "roll_out", "saturated_share", "servo_grid", "servo_grids"]
