"""Refinement of a model by output error: numbers of its laws that make open-loop roll-outs follow the recording.

`run` cuts windows, chooses laws and fits numbers (`fit`); the model that was given is kept
unless the refined one predicts windows better that took no part in the fit.
"""

from .fit import LAWS, Refinement, refine, refine_parts

__all__ = ["LAWS", "Refinement", "refine", "refine_parts"]
