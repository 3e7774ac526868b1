"""Sign recovery: signs of torques that were recorded as absolute values, with proof, confidence and flags.

A segment is a run of samples in which a joint moves and its torque keeps one sign. The signs of all segments are found
together by boolean least squares within physical constraints; README.md in this folder has the mathematics.

Files in the order of the data:

- `recover`: recordings -> recordings with signs, and flags. `torque_constants` comes first if constants are unknown.
- `observations` (recordings -> rows, absolute torque -> segments), `infer` (rows -> signs, confidence).
- `problem` (boolean least squares, friction prior), `branch_and_bound` within the physical cone, and `exact`, which
  begins with steepest ascent; `tree`: the classical search.
- `samples`: signs of samples and of rows of the file, jumps, expected signs.
- `result`: what `recover` returns.

Origins of tuned constants: "logs" are recordings of a Panda and a UR10e with known signs, cut and thinned in several
ways; "simulations" are UR5, UR10, Panda and xArm7 with friction and noise of 0 to 40 % of the rms torque. "Heuristic"
means that no measurement or derivation is recorded.
"""

from .recover import Recovered, prepare_and_recover, recover
from .result import Gain, SignProof, Signs, SignSegment, Trace

__all__ = ["Gain", "Recovered", "SignProof", "SignSegment", "Signs", "Trace", "prepare_and_recover", "recover"]
