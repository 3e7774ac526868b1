"""Search for the laws and numbers of drives, by windows that took no part in the fit."""
