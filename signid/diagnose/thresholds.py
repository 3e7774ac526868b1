"""Tuned settings: priors, friction near reversals, noise, discrepancy, search, verdict and findings.

"Prototype" and "simulated arms" mark values of a prototype that was tuned on simulated 3R, UR5 and Panda arms.
"Heuristic" marks values without a derivation. Ranks, ridges and grids of an algorithm stand beside the algorithm.
"""

from __future__ import annotations

from math import log

import numpy as np

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
KEPT_STRETCH_SHARE = 0.85  # [1] share of the stretches of replicates that is kept. Prototype
REPLICATE_STRETCHES = 8  # stretches of each piece. Heuristic
RELIABLE_STD = 0.003  # [1] rows count for noise if their reversal std is below this share of torque. Heuristic
OUTLIER_RATIO = 12.0  # [1] larger residuals, over their median size, are no noise (ends of a contact window). Heuristic
MIN_RELIABLE_SHARE = 0.3  # [1] least share of reliable rows; with fewer, all rows are used. Heuristic
MIN_MOVING_ROWS = 50  # rows in motion; with fewer, rows at rest are used too. Heuristic
WAVE_SHARE = 0.5  # [1] a sine with more than this share of a residual's power is a disturbance. Heuristic
SHAPES_IN_FIT = 6  # shapes of one hypothesis that enter the saturated fit. Heuristic
# Model discrepancy.
DISCREPANCY_LENGTHS = (1.5, 0.6)  # [1] kernel lengths, over the standard deviation of each variable. Heuristic
DIRECTION_WIDTH = 0.1  # [1] width of the change of direction, over the rms velocity. Heuristic
DISCREPANCY_SCALE = 0.02  # [1] scale of the half-Cauchy prior of s, as a share of the joint's rms torque. Heuristic
# Repetition of a motion.
PERIOD_TOLERANCE = 0.01  # [1] rms difference of two periods, over the standard deviation of positions. Heuristic
# Scale k of the error of what the simulation states: [1] standard deviations of its prior.
INERTIAL_SCALES = np.array([0.0, 1.0, 2.0])  # [1] without a covariance: of the tolerance of inertials. Prototype
LOG_INERTIAL_SCALE_PRIOR = np.log([0.5, 0.4, 0.1])  # [1] of each scale. Prototype
BARE_SCALES = np.array([0.0, 1.0, 2.0, 4.0, 6.0])  # [1] the same where the description states no friction either
LOG_BARE_SCALE_PRIOR = np.log([0.16, 0.25, 0.22, 0.13, 0.24])  # [1] of each: half-Cauchy of median 2. Heuristic
COVARIANCE_SCALES = np.array([1.0, 2.5])  # [1] with a covariance. Heuristic; idea: the ratio of Birge, 1932
LOG_COVARIANCE_SCALE_PRIOR = np.log([0.95, 0.05])  # [1] of each scale. Heuristic
INTERVAL_COVARIANCE_SCALES = np.array([1.0, 2.5, 6.0, 15.0])  # [1] with a covariance, for intervals. Heuristic
# Prior of the coefficients b of a hypothesis.
EFFECT_SIZES = np.array([0.006, 0.02, 0.06, 0.2, 0.6, 2.0])  # [1] f: rms torque over the joint's. Prototype, two added
SELECTED_SIZE = 1.0  # [1] f of a selected law: a weak prior, nearly no shrinkage. Heuristic
PRESENCE_STD = 0.15  # [1] of the coefficient 1 of a law without numbers. Prototype
APPROXIMATE_STD = 0.4  # [1] the same for transmission laws, whose columns are approximations. Prototype
BODY_LEVER = 0.1  # [m] distance of mass from the joint; relates mass, first moment and inertia. Prototype
# Prior probability of hypotheses.
PRIOR_NOTHING = 0.5  # [1] no hypothesis is true. Prototype
PRIOR_UNKNOWN = 0.02  # [1] an unknown dependence, if a hypothesis is true. Heuristic
ADDED_FREQUENCY = 0.1  # [1] of a law that `signid.effects` does not list and that states no `common`. Heuristic
ONE_JOINT_FACTOR = 0.3  # [1] factor for one joint alone with an effect that all joints may share. Prototype
# Noise floor beside the selected laws.
RELEVANT_FLOOR_SHARE = 0.8  # [1] a floor below this share of the saturated floor is measured again. Heuristic
MIN_FLOOR_SHARE = 0.7  # [1] lower bound of the floor, as a share of the saturated floor. Heuristic
# Misfit of an identified model.
MISFIT_GROWTH = 2.0  # [1] largest growth on other recordings: measured, .9 to 1.8 on a da Vinci PSM. Heuristic
# Stepwise selection (stepwise.py), log posterior odds [-]
FIRST_LOG_ODDS = 4.0  # needed by the first law; simulated arms
NEXT_LOG_ODDS = 3.0  # needed by each further law, and to stay; simulated arms
UNTRUSTED_LOG_ODDS = 5.0  # needed by the first law where inertials are probably wrong; simulated arms
IMITATED_LOG_ODDS = 8.0  # needed, in that case, by laws that wrong inertials imitate; simulated arms
EXCHANGE_LOG_ODDS = 2.0  # by which a rival must be better to replace a selected law; simulated arms
IMITATED_SHARE = 0.9  # share of a law's torque that wrong inertials must make to imitate it [1]; heuristic
MAX_SELECTED_LAWS = 14  # selected laws; heuristic
SHAPE_ERROR = 0.05  # error of a selected law's formula, over its torque [1]; simulated arms
MAX_INFLATION = 1.3  # bound of the dispersion with formula errors, over the mean square of the residual [1]; heuristic
# Admissible laws (stepwise.py)
MIN_LAW_TORQUE_SHARE = 0.007  # rms torque of a law over that of some joint [1]; simulated arms
ON_OFF_RANGE = (0.3, 2.0)  # fitted coefficient of a law without numbers, 1 where it holds exactly [1]; heuristic
ACTUATOR_RANGE = (0.6, 1.5)  # the same for actuator laws, such as saturation [1]; heuristic
INFEASIBLE_CHI2 = 4.0  # squared distance to consistent bodies, per number [variances]: two standard deviations
REDUNDANT_SHARE = 1e-3  # sum of squares of a law's columns that selected laws cannot make, over all [1]; heuristic
INERTIAL_VIOLATION = 30.0  # squared correction of a link's ten numbers at the largest tolerance [variances]; heuristic
# Outer loop (iterate.py)
NOISE_ERROR = 1.3  # variance of the whitened residual without any law [1]: error of the noise estimate; simulated arms
MODEL_ERROR = 0.003  # discrepancy of every simulation, over the rms torque [1]; simulated arms
WINDOWS_PER_ROW = 10  # contact windows that are compared, per row; log of their number is the penalty; simulated arms
RELINEARISATION_ROUNDS = 3  # heuristic
MAX_ADDED_LAWS = 2  # laws that relinearisation may add: more, and it diverges; heuristic
CORRECTION_SHARE = 0.5  # torque of a law that corrects the shape of another, over that one's, at most [1]; heuristic
NOISE_ROUNDS = 3  # alternations of noise estimation and search; heuristic
RELEVANT_CHI2 = 1.0  # squared change of torque by relinearisation [variances of the rows]: one standard deviation
# Pruning (stepwise.py)
SIGNIFICANT_CHI2 = 4.0  # squared coefficients, per number [variances]: two standard deviations
# Stability of a law's gain (contributions.py)
GAIN_BLOCKS, MIN_GAIN_BLOCKS = 8, 3  # blocks of rows with equal torque energy of the law; heuristic
MIN_TEST_PROBABILITY = 1e-15  # bound of the test's probability [1]: about the precision of a double
# Contact window (shapes.py)
CONTACT_WIDTHS = (0.5, 0.9, 1.5, 2.5, 4.0, 7.0)  # [s] first grid; heuristic
CONTACT_STEP = 0.2  # [s] between the starts of the first grid; heuristic
CONTACT_TORQUE = 0.15  # prior rms torque of the force over the rms torque [1]; heuristic
# Shape optimisation (shapes.py)
SHAPE_EVALUATIONS = 20  # evaluations of the optimiser per number of a shape; heuristic
ROUGH_EVALUATIONS = 6  # the same where it is only asked whether a law corrects the shapes of others; heuristic
RECOVERED_SHARE = 0.3  # of the log odds of a law that these must explain without it to go on [1]; heuristic
LOG_ODDS_TOLERANCE = 1e-4  # of the optimiser [-]; looser, shapes ended half a standard deviation apart by rounding
SHAPE_CHANGE_LOG_ODDS = 3.0  # by which another shape must explain more than the stated one [-]; e^3 to 1: strong
SHAPE_FACTOR = 1.6  # by which a shape may change from its grid value [1]: grids are coarser; heuristic
WINDOW_REACH = 0.5  # [s] by which the ends of a window may move; heuristic
SIZE_ROUNDS = 4  # times that the size of a recording law may grow by that factor again; heuristic
RECORDING_LIMITS = {"rad": 0.7, "s": 0.3}  # [rad], [s] sizes from which on a recording law is implausible; heuristic
# Alternatives (alternatives.py)
CAUSE_PROBABILITY = 0.2  # of a law that is reported [1]; heuristic
LISTED_PROBABILITY = 0.03  # of an alternative that is listed [1]; simulated arms
REPLACEMENT_RATIO = 1.5  # probability of a rival over that of a law that it replaces [1]; heuristic
REPLACEMENT_ROUNDS = 12  # replacements at most; heuristic
CHECKED_LOG_ODDS = 4.0  # log odds behind the best within which rivals must be admissible to count [-]; heuristic
COMPARED_LOG_ODDS = 40.0  # log odds behind a law beyond which rivals are not compared [-]: exp(-40) is no probability
RIVAL_RESIDUAL_SHARE = 0.5  # of a law's torque that a rival of the same torque may leave [squares, 1]; heuristic
SAME_TORQUE_CHI2 = 4.0  # the same in variances of the noise: two standard deviations, not distinguishable below
FORMULA_ERROR = 0.2  # torque that the formula of a real law misses, over its torque [1]; heuristic
MAX_IN_STEP_LOG_ODDS = log(0.95 / 0.05)  # of laws of joints that moved in step [-]: a probability of .95; heuristic
# Verdict (verdict.py)
MIN_DRIFT_SHARE = 0.5  # drift of a number, against its difference from the stated one, that explains it [1]; heuristic
MIN_CAUSE_SHARE = 0.15  # importance of a cause over the largest [1]: less is a correction; heuristic
PROMOTED_TORQUE_SHARE = 0.03  # torque share of a correction that becomes a cause [1]; heuristic
PROMOTED_HELD_OUT_GAIN = 0.2  # held-out gain that it needs as well [1]; heuristic
MIN_NOTICED_DISCREPANCY = 0.01  # of the torque [1]: a larger one that follows the joint's state is unknown; heuristic
MIN_EXPLAINED_EXCESS = 0.6  # excess that the causes must explain, over all at their joints [1]; heuristic
MIN_APPROXIMATED_EXCESS = 0.5  # the same where the first cause has an approximate formula [1]; simulated arms
NOTICED_DEVIATIONS = 4.0  # excess of a joint that is noticed [standard deviations of a sum of squares]; heuristic
TOLERATED_DISCREPANCY = 0.006  # discrepancy of every simulation that is no fault, over the rms torque [1]; heuristic
MIN_JOINT_SHARE = 0.1  # rms torque of a joint, over the largest [1]: weaker joints count as this strong; heuristic
CLEAR_LOG_ODDS = 20.0  # log odds of a dependence without law that make something missing for certain [-]; heuristic
CLEAR_FACTOR = 0.8  # factor of the threshold in that case [1]; heuristic
STATELESS_FACTOR = 3.0  # factor of the threshold of what depends on no variable [1]; heuristic
MAX_ELSEWHERE_SHARE = 0.25  # excess that causes at other joints leave of a joint's, over all [1]; heuristic
QUIET_NOISE_RATIO = 1.3  # residual rms over noise and known misfit up to which nothing is missing [1]; heuristic
QUIET_TORQUE_SHARE = 0.05  # residual rms over the joint's torque up to which nothing is missing [1]; heuristic
USUAL_BODY_SHARE = 0.1  # residual rms over the joint's torque that bodies within their tolerance make [1]; heuristic
SMALL_EXCESS_SHARE = 0.1  # excess that does not matter, over the largest [1]; heuristic
# Held-out selection (held_out_selection.py)
HELD_OUT_BLOCKS = 20  # blocks of held-out rows for standard errors; heuristic
WORSE_WEIGHT = 3.0  # additional weight of joints that are predicted worse, or not clearly better [1]; heuristic
MIN_REFIT_GAIN = 1.0  # log mean square that all refitted numbers together must gain, or a separate fit [-]; heuristic
MIN_REFIT_BLOCK_GAIN = 0.5  # the same for the numbers of one joint, or of the bodies [-]; heuristic
EQUAL_PREDICTION_GAIN = 0.1  # log mean square by which two extensions predict held-out rows equally well [-]; heuristic
MIN_REFIT_ROWS = 40  # held-out rows without which stated numbers are not refitted; heuristic
MIN_RESIDUAL_RATIO = 1e-3  # residual rms over torque rms: smaller residuals count as this large [1]; heuristic
CORRELATED_ROWS = 4.0  # rows per independent row; heuristic
# Findings (findings.py)
AMBIGUOUS_WORDS = "is one of several laws that explain the recordings"  # part of the flag on such a cause
SURE_PROBABILITY = 0.95  # probability of a cause below which a flag names its rivals [1]; heuristic
CHANGED_PROBABILITY = 0.5  # probability of a changed number that is reported as changed [1]; more likely than not
PLAUSIBLE_PROBABILITY = 0.05  # probability of a rival above which a separating motion is sought [1]; heuristic
MOTIONS_PER_FINDING = 4  # separating motions of one finding: each search simulates several motions
MAX_MOTIONS = 2 * MOTIONS_PER_FINDING  # separating motions of all findings
VAGUE_DEVIATIONS = 0.5  # standard deviations from zero below which a coefficient is vague [1]; heuristic
# Held-out prediction (findings.py)
EMPIRICAL_GAIN = 0.3  # share of the held-out sum of squares that an empirical function must remove [1]; heuristic
WORSE_RMS = 1.05  # held-out rms after over before that is worse [1]; heuristic
WORSE_ROLLOUT = 1.2  # median roll-out error after over before that is worse [1]; heuristic
SURE_ERRORS = 2.0  # standard errors by which roll-outs must be worse [1]
MIN_WINDOWS = 8  # windows that roll-outs are compared in, at least
LOUD_RATIO = 3.0  # held-out rms over irreducible rms above which it matters [1]; heuristic
# Intervals (intervals.py)
BLOCK_PERIODS = 8.0  # length of a block, in periods of the cut-off frequency [1]: longer than the residual correlates
MAX_JACKKNIFE_PARTS = 10  # parts of the jackknife at most; heuristic
