"""Tuned constants of the search.

"Simulated arms" stands for a prototype tuned on simulated 3R, UR5 and Panda arms; "heuristic" for no such origin.
"""

# Stepwise selection (stepwise.py), log posterior odds [-]
FIRST_LOG_ODDS = 4.0  # needed by the first law; simulated arms
NEXT_LOG_ODDS = 3.0  # needed by each further law, and to stay; simulated arms
UNTRUSTED_LOG_ODDS = 5.0  # needed by the first law where inertials are probably wrong; simulated arms
IMITATED_LOG_ODDS = 8.0  # needed, in that case, by laws that wrong inertials imitate; simulated arms
EXCHANGE_LOG_ODDS = 2.0  # by which a rival must be better to replace a selected law; simulated arms
IMITATED_SHARE = 0.9  # share of a law's torque that wrong inertials must make to imitate it [1]; heuristic
MAX_LAWS = 14  # selected laws; heuristic
SHAPE_ERROR = 0.05  # error of a selected law's formula, over its torque [1]; simulated arms
MAX_INFLATION = 1.3  # bound of the dispersion with formula errors, over the mean square of the residual [1]; heuristic

# Admissible laws (admissible.py)
LEAST_TORQUE_SHARE = 0.007  # rms torque of a law over that of some joint [1]; simulated arms
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

# Stability of a law's gain (steady.py)
BLOCKS, LEAST_BLOCKS = 8, 3  # blocks of rows with equal torque energy of the law, and the fewest for a test; heuristic
LEAST_PROBABILITY = 1e-15  # bound of the test's probability [1]: about the precision of a double

# Contact window (contact_window.py)
CONTACT_WIDTHS = (0.5, 0.9, 1.5, 2.5, 4.0, 7.0)  # [s] first grid; heuristic
CONTACT_STEP = 0.2  # [s] between the starts of the first grid; heuristic
CONTACT_TORQUE = 0.15  # prior rms torque of the force over the rms torque [1]; heuristic

# Shape optimisation (shape_optimisation.py)
EVALUATIONS_PER_SHAPE = 20  # evaluations of the optimiser; heuristic
LOG_ODDS_TOLERANCE = 1e-4  # of the optimiser [-]; looser, shapes ended half a standard deviation apart by rounding
SHAPE_CHANGES = 3.0  # log odds by which another shape must explain more than the stated one [-]; e^3 to 1: strong
SHAPE_FACTOR = 1.6  # by which a shape may change from its grid value [1]: grids are coarser; heuristic
WINDOW_REACH = 0.5  # [s] by which the ends of a window may move; heuristic
SIZE_ROUNDS = 4  # times that the size of a recording law may grow by that factor again; heuristic
RECORDING_LIMITS = {"rad": 0.7, "s": 0.3}  # [rad], [s] sizes from which on a recording law is implausible; heuristic
