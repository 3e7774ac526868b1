"""Identify position drives from commanded and measured positions: law, numbers, intervals, what is identifiable."""

from .result import ServoIdentification, ServoJoint, ServoNumber, ServoRollOut, ServoScale, ServoTrace

__all__ = ["ServoIdentification", "ServoJoint", "ServoNumber", "ServoRollOut", "ServoScale", "ServoTrace"]
