"""Parts of `benchmarks.regressor` and `benchmarks.peers`: the same job by others, timed or heard beside signid."""
