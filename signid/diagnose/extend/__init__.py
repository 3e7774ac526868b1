"""Laws and numbers -> the extended simulation, and its residuals on held-out recordings."""
