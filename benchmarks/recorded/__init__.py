"""Real recordings diagnosed by simulations from which known physics was left out."""
