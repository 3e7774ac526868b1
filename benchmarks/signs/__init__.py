"""Parts of `benchmarks.signs`: torque whose sign was thrown away, and what was found of it."""
