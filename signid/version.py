"""Version of signid, stored in every result."""

__version__ = "0.1.0"
