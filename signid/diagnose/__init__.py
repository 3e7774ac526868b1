"""Compare a simulation with recordings: locate the mismatch, name the missing physics, extend the simulation.

The residual torque is located: at which joint, on which variable it depends, in which region. Then every law of
`signid.effects` is tried at every joint, also several together, against dependences on a position, a velocity, an
acceleration, a torque or time that no law explains.

The result is a `Diagnosis`. Its `causes` are the missing laws: each is a `Finding` with numbers, standard deviations, a
probability, and `alternatives` with the motion that would separate them. Its `model` is the extended simulation,
evaluated on held-out recordings. Its `flags` name the results that are unreliable.

Data flow, in the order of `run`:

- `run`: session, recording faults and dataset;
- `data`: rows of all hypotheses, their noise and its whitening;
- `evidence`: normal equations, likelihood, prior, Bayes factors and posterior odds;
- `search`: selected laws, by stepwise search, shape optimisation, relinearisation and pruning;
- `extend`: extended simulation and its residuals;
- `findings`: verdict, findings, and the extended simulation that is returned;
- `detectable`: the smallest law of each kind that would have been named.

`README.md` in this folder states the model with formulas and sources.
"""

import sys
from typing import TYPE_CHECKING

from ..registry import inner_package as _package, public_names as _names

if TYPE_CHECKING:
    from .result import Alternative as Alternative, Detectable as Detectable, Diagnosis as Diagnosis  # isort: skip
    from .result import Finding as Finding, Unexplained as Unexplained
    from .run import diagnose as diagnose

NAMES = _names(__name__)

sys.modules[__name__].__class__ = _package(__name__, NAMES)
