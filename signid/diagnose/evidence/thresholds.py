"""Tuned priors of the evidence: size of effects, probability of hypotheses, error of what the simulation states.

"Prototype" marks values of a throw-away prototype that was tuned on simulated 3R, UR5 and Panda arms. "Heuristic"
marks values without a derivation.
"""

from __future__ import annotations

import numpy as np

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
SINGLE_JOINT = 0.3  # [1] factor for one joint alone with an effect that all joints may share. Prototype

# Noise floor beside the selected laws.
RELEVANT_DROP = 0.8  # [1] a floor below this share of the saturated floor makes that floor be measured again. Heuristic
MIN_FLOOR = 0.7  # [1] lower bound of the floor, as a share of the saturated floor. Heuristic

# Misfit of an identified model.
MISFIT_GROWTH = 2.0  # [1] largest growth on other recordings: measured, .9 to 1.8 on a da Vinci PSM. Heuristic
