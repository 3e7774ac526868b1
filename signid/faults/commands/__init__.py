"""Audit of servo recordings: lag, bandwidth, errors at rest, saturation, faults of the log; without a description."""

from .audit import audit_flags, audit_servos

__all__ = ["audit_flags", "audit_servos"]
