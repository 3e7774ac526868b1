"""Diagnosis of known changes on real robots: names, parameters and prediction of held-out recordings."""
