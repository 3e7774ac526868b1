"""Diagnosis of real recordings with simulations that lack known physics."""
