"""Torque whose sign was lost: segments, a search over their signs, and how sure each is.

A segment is a stretch in which a joint moves and its torque keeps one sign. The signs of all segments are searched
together, as friction brakes, inertia is positive, and joints feel each other; the search proves that no other choice
fits better, or tells by how much one could. Flags say when the model or the motion is too poor to believe it.

The way of the data through these files:

- `recover`: recordings to recordings with signs, by all that follows. `gains` finds torque constants that are not known
  first, from base parameters that joints share (`gains_shared`) or from the description (`gains_described`).
- `observed`: recordings to rows. `segments`: stretches of one sign. `problem`: segments to boolean least squares, all
  parameters eliminated, with weak rows on friction beside it (`friction_prior`).
- `infer`: rows to signs. `exact`: the search, by `climb` (good signs at once), `certificate` (eigenvalues) and `branch`
  (and bound), within the `cone` of what physics allows; `scores` holds the losses, `friction_signs` what to try.
- `tree`: the classical search, with `condition` for the order of segments and `beam` for the nodes; `classical` puts it
  in the place of the exact one.
- `chain`: parameters to the signs of single samples, and back. `reversals`: where friction turns round.
- `recheck`: the search again, in variance units (`inflation`), and its rivals counted. `confidence`: how probable each
  sign is. `flags`: when not to believe it. `result`: what is handed back.
- `spread`: signs of samples to every row of the file. `jumps`: where exactly torque jumped past zero. `expect`: what a
  sign is on average, for a fit without bias.
"""

from .recover import Recovered, recover
from .result import Gain, SignProof, Signs, SignSegment, Trace

__all__ = ["Gain", "SignProof", "Recovered", "Signs", "SignSegment", "Trace", "recover"]
