"""Sign recovery: signs of torques that were recorded as absolute values, with proof, confidence and flags.

A segment is a run of samples in which a joint moves and its torque keeps one sign. The signs of all segments are found
together by boolean least squares within physical constraints; README.md in this folder has the mathematics.

Files in the order of the data:

- `recover`: recordings -> recordings with signs. `torque_constants` comes first if constants are unknown: `find`,
  `constants`.
- `observations` (recordings -> rows), `segments` (absolute torque -> segments), `infer` (rows -> signs).
- `search`: `problem` (boolean least squares, friction prior), `cone` (physical constraints), `exact` (the search) with
  `local_search` and `branch_and_bound`.
- `tree`: the classical search, with `condition` (order of segments).
- `samples`: `markov_chain` (signs of samples), `full_rate` (jumps, expected signs), `rows_of_file`.
- `posterior` (search of segments, confidence), `flags`.
- `result`: what `recover` returns. `thresholds`: tuned values.
"""

from .recover import Recovered, prepare_and_recover, recover
from .result import Gain, SignProof, Signs, SignSegment, Trace

__all__ = ["Gain", "Recovered", "SignProof", "SignSegment", "Signs", "Trace", "prepare_and_recover", "recover"]
