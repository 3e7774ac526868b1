"""Tuned constants of the verdict and of the findings.

"Simulated arms" stands for a prototype tuned on simulated 3R, UR5 and Panda arms; "heuristic" for no such origin.
"""

from math import log

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

# Held-out prediction (held_out_prediction.py)
EMPIRICAL_GAIN = 0.3  # share of the held-out sum of squares that an empirical function must remove [1]; heuristic
WORSE_RMS = 1.05  # held-out rms after over before that is worse [1]; heuristic
WORSE_ROLLOUT = 1.2  # median roll-out error after over before that is worse [1]; heuristic
SURE_ERRORS = 2.0  # standard errors by which roll-outs must be worse [1]
MIN_WINDOWS = 8  # windows that roll-outs are compared in, at least
LOUD_RATIO = 3.0  # held-out rms over irreducible rms above which it matters [1]; heuristic

# Intervals (intervals.py)
BLOCK_PERIODS = 8.0  # length of a block, in periods of the cut-off frequency [1]: longer than the residual correlates
MAX_JACKKNIFE_PARTS = 10  # parts of the jackknife at most; heuristic
