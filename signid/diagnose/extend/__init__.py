"""Extended simulation: selected laws and refitted numbers added to the simulation, and the residuals that remain."""
