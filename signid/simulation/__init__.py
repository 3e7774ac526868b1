"""A model and inputs -> motion: the simulated plant, roll-outs from measured states, exciting motions."""
