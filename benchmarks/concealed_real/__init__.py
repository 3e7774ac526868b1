"""Diagnosis of known changes on real robots: names, numbers, and prediction of unseen recordings."""
