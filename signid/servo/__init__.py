"""Servo mode: robots that log commands and positions, and no torque."""
