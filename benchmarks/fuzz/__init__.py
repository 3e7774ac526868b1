"""Parts of `benchmarks.fuzz`: readers of files, and files that they begin from."""
