"""Parts of `benchmarks.concealed` and `benchmarks.gross`: concealed physics, and the judge of a diagnosis."""
