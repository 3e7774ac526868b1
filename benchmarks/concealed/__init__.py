"""Parts of `benchmarks.concealed`: concealed physics, and the judge of a diagnosis."""
