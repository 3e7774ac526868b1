"""Audit of servo recordings: lag, bandwidth, droop, saturation, faults of the log; no description of the robot."""

from .result import JointAudit, ServoAudit
from .run import audit_flags, audit_servos

__all__ = ["JointAudit", "ServoAudit", "audit_flags", "audit_servos"]
