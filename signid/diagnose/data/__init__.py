"""Rows of all hypotheses from recordings: motions, columns, noise, whitening."""
