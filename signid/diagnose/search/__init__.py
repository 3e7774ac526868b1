"""Evidence -> the selected laws: stepwise search, shapes, relinearisation, pruning."""
