"""Version of signid, stored in every result."""

__version__ = "0.2.0"
