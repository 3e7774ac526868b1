"""Simulation and recordings -> where they differ, why, and the simulation that lacks nothing more.

Torque that the simulation leaves unexplained is located: at which joint, on what it depends, in which region. Then
every law of `signid.effects` is tried at every joint, several together, and held against torque that depends on a
position, a velocity, an acceleration, a torque or time in a way that no law explains.

What is found is a `Diagnosis`. Its `causes` are what the simulation lacks: each a `Finding`, a law with numbers,
standard deviations, a probability, and `alternatives` that explain the same, with the motion that would tell them
apart. Its `model` is the simulation with what it lacked, judged on recordings that took no part. `flags` say what not
to trust.

The way of the data, as `run` goes it:

- `data`: recordings to rows of all hypotheses, their noise and its whitening;
- `evidence`: rows to normal equations, likelihood, prior, Bayes factors and posterior odds;
- `extend`: laws and numbers to the extended simulation, and its residuals;
- `search`: evidence to the selected laws, step by step, with shapes, relinearisation and pruning;
- `findings`: the selected laws to what is reported, and to the extended simulation that is handed out.

The model behind it, with formulas and sources, is `README.md` in this folder.
"""

import sys
from typing import TYPE_CHECKING

from ..registry import inner_package as _package, public_names as _names

if TYPE_CHECKING:
    from .result import Alternative as Alternative, Diagnosis as Diagnosis, Finding as Finding  # isort: skip
    from .result import Unexplained as Unexplained
    from .run import diagnose as diagnose

NAMES = _names(__name__)

sys.modules[__name__].__class__ = _package(__name__, NAMES)
