"""Model selection: stepwise search, shape optimisation, relinearisation, pruning."""
