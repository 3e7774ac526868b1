"""Signs of segments -> signs of samples and rows: hidden Markov chain, jumps, expected signs."""
