"""Rows -> parameters: least squares, estimators, feasible standard parameters, quality of the fit."""
