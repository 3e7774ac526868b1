"""Fleets of robots: sessions run in parallel on one or several machines, and their joint evaluation."""
