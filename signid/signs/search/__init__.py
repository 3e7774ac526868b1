"""Exact search for signs: boolean least squares, physical cone, certificate, branch and bound, local search."""
