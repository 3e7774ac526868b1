"""Simulation and recordings -> where they differ, why, and the simulation that lacks nothing more.

Torque that the simulation leaves unexplained is located: at which joint, on what it depends, in which region. Then
every law of `signid.effects` is tried at every joint, several together, and held against torque that depends on a
position, a velocity, an acceleration, a torque or time in a way that no law explains.

What is found is a `Diagnosis`. Its `causes` are what the simulation lacks: each a `Finding`, a law with numbers,
standard deviations, a probability, and `alternatives` that explain the same, with the motion that would tell them
apart. Its `model` is the simulation with what it lacked, judged on recordings that took no part. `flags` say what not
to trust.

The way of the data through the files, as `run` goes it:

- recordings to rows: `enough`, `sample` (motions and residual), `hypothesis`, `group` (what columns mean), `table`,
  `period`, `noise`, `wave`, `discrepancy`, `whitening`, `whitened`, `setting` (all of these together);
- rows to evidence: `knowledge` and `prior`, `components`, `linear` and `fitted` (normal equations), `batches`,
  `evidence`, `odds`;
- evidence to the selected laws: `explain` by `search`, `sound`, `sizes`, `strain`, `contact`, `refine`, `noise_model`
  (what the selected laws leave), `linearise` (what laws do to each other), then `prune`;
- to what is said: `slots` by `likelihood` and `steady` (how sure), `verdict`, `findings` with `numbers`,
  `intervals`, `locate` and `separate`;
- to the extended simulation: `handout` by `trials`, `extend` and `bodies`, `empirical`, judged by `prove`, `doubt`
  and, where nothing else holds, `fallback`.

The model behind it, with formulas and sources, is `README.md` in this folder.
"""

import sys
from typing import TYPE_CHECKING

from ..registry import inner_package as _package

if TYPE_CHECKING:
    from .result import Alternative as Alternative, Diagnosis as Diagnosis, Finding as Finding  # isort: skip
    from .result import Unexplained as Unexplained
    from .run import diagnose as diagnose

NAMES = {"diagnose.result": "Alternative Diagnosis Finding Unexplained", "diagnose.run": "diagnose"}

sys.modules[__name__].__class__ = _package(NAMES)
