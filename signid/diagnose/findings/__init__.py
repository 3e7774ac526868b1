"""Findings: verdict, alternatives, held-out selection, intervals, and the extended simulation that is returned."""
