"""Posterior of the signs: second search in standard deviations, confidence, flags."""
