"""Sign recovery: signs of torques that were recorded as absolute values, with proof, confidence and flags.

A segment is a run of samples in which a joint moves and its torque keeps one sign. The signs of all segments are found
together by boolean least squares within physical constraints; README.md in this folder has the mathematics.

Files in the order of the data:

- `recover`: recordings -> recordings with signs, and flags. `torque_constants` comes first if constants are unknown.
- `observations` (recordings -> rows), `segments` (absolute torque -> segments), `infer` (rows -> signs, confidence).
- `search`: `problem` (boolean least squares, friction prior), `branch_and_bound` within the physical cone, and
  `exact`, which begins with steepest ascent.
- `tree`: the classical search.
- `samples` (signs of samples, jumps, expected signs), `rows_of_file`.
- `result`: what `recover` returns. `thresholds`: tuned values.
"""

from .recover import Recovered, prepare_and_recover, recover
from .result import Gain, SignProof, Signs, SignSegment, Trace

__all__ = ["Gain", "Recovered", "SignProof", "SignSegment", "Signs", "Trace", "prepare_and_recover", "recover"]
