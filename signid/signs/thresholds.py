"""Thresholds of sign recovery that were tuned, or that several files share: value, unit and origin of each.

Origins: "logs" are recordings of a Panda and a UR10e with known signs, cut and thinned in several ways; "simulations"
are UR5, UR10, Panda and xArm7 with friction and noise of 0 to 40 % of the rms torque. "Heuristic" means that no
measurement or derivation is recorded. Constants of a single algorithm stand in its own file.
"""

from __future__ import annotations

# Observations: grid of the samples that are searched

CUTOFF_SAMPLES = 8.0  # [samples per period of the cut-off] density of the grid; heuristic
MIN_GRID_RATE = 100.0  # [Hz]; logs: one UR10e recording had impure segments at 47 Hz, none at 94 Hz
MAX_GRID_SAMPLES = 20_000  # [samples] of all recordings; longer ones are thinned further; heuristic: memory, time
POSITION_BANDWIDTH = 2.0  # [cut-offs] positions pass up to here: less than in a fit, since torque stays unfiltered and
# encoder noise in the acceleration hides small torques; heuristic

# Segments: stretches of one sign

SEGMENT_QUANTILE = 0.1  # [1] of |torque| in motion: samples below it belong to no segment; logs: at 0.1 all segments of
# 7 of 8 recordings were pure; at 0.05 up to 5 segments of a recording were impure, at 0.02 up to 14
SEGMENT_DURATION = 0.2  # [s] shortest segment; logs: 20 samples at 100 Hz
SEGMENT_SAMPLES = 5  # [samples] shortest segment, if longer ones would leave out too much torque; logs, as above
SEGMENT_COVERAGE = 0.5  # [1] share of the samples above the threshold that segments must hold; heuristic
REST_DURATION = 0.1  # [s] without certain motion after which a joint counts as at rest; heuristic
MOVING_SHARE = 0.1  # [1] of the samples: a joint that moves in fewer is reported as resting; heuristic
MINIMUM_CEILING = 0.5  # [rms torque] local minima of |torque| below it are cut; logs: impurity <= 0.1 % of the samples
MINIMUM_FLOOR = 0.02  # [rms torque] samples below it belong to no segment between minima; logs, as above
SPLIT_DEVIATIONS = 3.0  # [standard deviations of the residual] of a model torque whose sign is clear; heuristic
SPLIT_SAMPLES = 3  # [samples] a run of clear signs must be longer to split a segment; heuristic
MAX_SPLITS = 3  # [rounds] of search and splitting; heuristic
JUMP_TORQUE = 0.15  # [rms torque] where |torque| stays above it the torque jumped past zero; heuristic

# Physics

OFFSET_LIMIT = 2.0  # [Coulomb friction] largest |offset|; logs: 0 to 0.8 with true signs, above 1e5 if the signs of a
# joint follow an offset instead of friction
FRICTION_PRIOR = {  # [rms torque of the joint, at its rms velocity] mean, standard deviation
    "torque_offset": (0.0, 0.15),
    "coulomb_friction": (0.1, 0.1),
    "viscous_friction": (0.1, 0.1),
}  # logs and simulations: trees 2 to 20 times smaller
PRIOR_STRENGTH = 0.3  # [1] weight of the friction prior; logs: at 1 it biases real data (93 % of the segments right)

# Search and posterior

RIVAL_WINDOW = 24.0  # [squared standard deviations] of excess loss: a rival beyond it weighs less than exp(-12) = 6e-6
CERTAIN_CONFIDENCE = 0.999  # [1] confidence of a certain sign; logs and simulations: none of 2236 such signs was wrong
NOISE_FLOOR = 1e-3  # [rms torque] smallest residual that the posterior assumes; heuristic
RECHECK_ROUNDS = 2  # [rounds] of the search in variance units; heuristic
UNPROVED_GAP = 0.995  # [1] relative gap that rounds to 100 %: the lower bound excludes nothing

# Flags

MAX_RESIDUAL_SHARE = 0.15  # [rms torque] rms residual of a model that lacks physics; heuristic
MAX_RESIDUAL_KAPPA = 3.0  # [samples per independent one] of a systematic residual; white noise has 1, logs had 3 to 40
FLIP_PROBABILITY = 1e-3  # [1] that all signs of a joint are inverted; the complement of CERTAIN_CONFIDENCE
NEAR_OFFSET_LIMIT = 0.95  # [OFFSET_LIMIT] an offset so close to its limit may be friction of the wrong sign; heuristic
OFFSET_DEVIATIONS = 2.0  # [standard deviations] by which an offset must exceed that; about 95 % of a normal law
MIN_BODY_TORQUE = 0.02  # [rms torque] standard deviation of the rigid-body torque that noise hides; heuristic
MAX_RESOLUTION_STEP = 0.15  # [rms torque] resolution; simulations: 98 % of the segments right at 0.1, 84 % at 0.3
IMPURE_SHARE = 0.1  # [1] of a joint's segments in which torque changed its sign; heuristic
MAX_ROUND_CHANGE = 1e-3  # [1] relative change of the parameters in the last round of refinement; heuristic

# Torque constants

INERTIAL_ERROR = 0.2  # [1] relative standard deviation of a link's stated mass, first moment and inertia; heuristic
MAX_CONSTANT_STD = 0.5  # [1] relative standard deviation from which a constant counts as unknown; heuristic
