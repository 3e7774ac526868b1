"""Tuned settings of the rows: priors of stated numbers, friction near reversals, noise, discrepancy.

"Prototype" marks values of a throw-away prototype that was tuned on simulated 3R, UR5 and Panda arms. "Heuristic"
marks values without a derivation. Ranks, ridges and grids of an algorithm stand beside the algorithm.
"""

from __future__ import annotations

# Prior standard deviations of what the simulation states, k = 1, where it carries no covariance.
FRICTION_STD = 0.1  # [1] friction and torque offsets, as a share of the coefficient. Heuristic: day-to-day change
LAW_STD = 0.03  # [1] coefficients of all other laws, as a share. Heuristic
OFFSET_STD = 0.05  # [1] lower bound for a torque offset, as a share of the joint's dry friction. Heuristic
MASS_STD = 0.05  # [1] mass, as a share. Prototype
CENTRE_STD = 0.005  # [m] centre of mass. Prototype
INERTIA_STD = 0.1  # [1] moments of inertia, as a share of the largest. Prototype
MIN_MASS = 0.05  # [kg] lower bound of the mass that the shares refer to. Heuristic
FLAT_PRECISION = 1e-6  # [1] precision of a flat prior, as a share of the Gram's diagonal. Prototype

# Friction near velocity reversals.
REVERSAL_STD = 0.7  # [1] prior std of the three shape columns, as a share of the joint's dry friction. Prototype
REVERSAL_WIDTHS = (0.3, 3.0)  # [1] steeper and softer reversal, over the presumed width. Prototype
REVERSAL_LEAD = 0.008  # [s] friction may change sign before the velocity: one sample at 125 Hz. Prototype
REVERSAL_TIME_STD = 0.006  # [s] standard deviation of the time of a reversal. Heuristic
REVERSAL_SCALES = (0.0, 0.3, 0.6, 1.0, 1.3, 1.7, 2.2, 3.0)  # [1] grid of the scale of that deviation. Heuristic
REST_SPEED = 2.0  # [1] a joint below this many reversal widths is at rest. Heuristic
REST_TIME = 0.3  # [s] shortest rest for which held-out rows are ignored. Heuristic
STATIC_OVER_DRY = 2.0  # [1] largest static over dry friction in motion. Armstrong 1994: 1.1 to 2
HOLD_TIME = 0.1  # [s] shortest rest for which rows are ignored: static friction may hold the joint. Heuristic

# Units of torque.
MIN_TORQUE = 0.02  # [1] lower bound of a joint's rms torque, as a share of the largest joint's. Prototype

# Noise model.
AR_ORDER = 4  # order of the autoregressive model. Prototype
MAX_AR_ROOT = 0.75  # [1] largest root: slower correlation is drift, friction or discrepancy. Heuristic
ROWS_PER_DIRECTION = 3.0  # [1] least number of rows for each direction of the saturated fit. Prototype
REPLICATE_FACTOR = 1.06  # [1] corrects the rms of replicates for the discarded stretches. Prototype
QUIET_SHARE = 0.85  # [1] share of the stretches of replicates that is kept. Prototype
REPLICATE_STRETCHES = 8  # stretches of each piece. Heuristic
RELIABLE_STD = 0.003  # [1] rows count for noise if their reversal std is below this share of torque. Heuristic
OUTLIER = 12.0  # [1] larger residuals, over their median size, are no noise (ends of a contact window). Heuristic
MIN_RELIABLE = 0.3  # [1] least share of reliable rows; with fewer, all rows are used. Heuristic
MIN_MOVING = 50  # rows in motion; with fewer, rows at rest are used too. Heuristic
WAVE_SHARE = 0.5  # [1] a sine with more than this share of a residual's power is a disturbance. Heuristic
SHAPES_IN_FIT = 6  # shapes of one hypothesis that enter the saturated fit. Heuristic

# Model discrepancy.
DISCREPANCY_LENGTHS = (1.5, 0.6)  # [1] kernel lengths, over the standard deviation of each variable. Heuristic
DIRECTION_WIDTH = 0.1  # [1] width of the change of direction, over the rms velocity. Heuristic
DISCREPANCY_SCALE = 0.02  # [1] scale of the half-Cauchy prior of s, as a share of the joint's rms torque. Heuristic

# Repetition of a motion.
PERIOD_TOLERANCE = 0.01  # [1] rms difference of two periods, over the standard deviation of positions. Heuristic
