"""Frozen suite: outputs of many commands, compared with those of another commit or with stored numbers."""
