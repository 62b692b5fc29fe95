"""Identification of a model from a record by separable least squares.

Weights, offset, initial memory and coefficients of added effects are linear and solved for;
the one to few nonlinear parameters of the effects are found outside, from a coarse grid by
Gauss-Newton steps with derivatives through the model.
"""
