"""Diagnosis: JSON document, terminal tables, parameters and sentences."""
