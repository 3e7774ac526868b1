"""Demonstration: record a robot whose simulation lacks physics, diagnose it and verify the result."""
