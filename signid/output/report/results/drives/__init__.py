"""Results on position drives beside their identification and validation."""
