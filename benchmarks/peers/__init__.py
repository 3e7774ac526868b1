"""Parts of `benchmarks.peers`: faults, the recordings that have them, and what signid and its peers say of these."""
