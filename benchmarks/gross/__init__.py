"""Parts of `benchmarks.gross`: faults that are planted in the columns of recordings."""
