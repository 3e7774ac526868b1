"""Signs of segments -> signs of samples: jumps, hidden Markov chain, expected signs."""
