"""A diagnosis as document, tables, numbers and sentences."""
