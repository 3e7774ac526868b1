"""Code of a model's dynamics for controllers and optimisers: C99, and Python over an array namespace.

The equations of the bodies and of the laws are traced once into a graph without repetitions, zeros and ones; each
language writes it.
"""
