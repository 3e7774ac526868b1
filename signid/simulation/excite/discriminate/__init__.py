"""Motions that make two laws predict different torque."""
