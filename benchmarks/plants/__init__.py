"""Simulated robots that share no code with signid, as independent references."""
