"""Model and inputs -> motion: simulated plant, roll-outs from measured states, exciting motions."""
