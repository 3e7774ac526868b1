"""Exact search for signs: boolean least squares, certificate, branch and bound, local search."""
