"""Recordings -> rows of all hypotheses: motions, columns, noise, whitening."""
