"""Parts of `benchmarks.regressor`: one job, and others that do it."""
