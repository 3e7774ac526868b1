"""Parts of `benchmarks.real`: real recordings diagnosed by simulations from which known physics was left out."""
