"""Rows -> evidence: prior, normal equations, likelihood, Bayes factors, posterior odds."""
