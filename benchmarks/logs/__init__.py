"""Changes of a log that must not matter."""
