"""Fuzzing of file readers: readers under test and seed files."""
