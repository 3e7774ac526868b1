"""Accuracy of servo identification: MuJoCo with known truth, real recordings, CMA-ES beside it."""
