"""Finding that gravity acts otherwise than in the simulation; it is determined before the search for other laws."""

from __future__ import annotations

import numpy as np

from ...effects import EFFECTS
from ...faults import RecordingFault
from ...model import Model
from ...types import Law
from ..data.dataset import Dataset
from ..data.hypotheses import GRAVITY, VARIABLES
from ..data.locate import locate
from ..extend.holdout import Prediction
from ..result import Finding
from ..search.thresholds import FIRST_LOG_ODDS
from .findings import Conclusions
from .stated import MOST_LOG_ODDS, torque_share

NATS = 4.0  # log odds per nat of log unexplained shares: half of the blocks, as if each were one independent row
WEIGHTLESS = (
    "the recorded torque carries no weight of the robot, so masses are not identifiable; log the whole torque, or "
    "state it with --gravity 0,0,0"
)


def with_gravity_finding(
    result: Conclusions, fault: RecordingFault, given: Model, before: Prediction, dataset: Dataset
) -> Conclusions:
    """Put gravity before the other findings.

    given: the simulation with its own gravity, and `before` its prediction; the dataset has the gravity that was found.
    """
    effect, joints = EFFECTS[GRAVITY], tuple(range(len(given.robot.joints)))
    value = {key: fault.measures[key] for key in "xyz"}
    stated = dict(zip("xyz", map(float, given.robot.model.gravity.linear), strict=True))
    torque = dataset.torque(Law(effect, joints, stated))  # what the simulation had instead
    scale = np.sqrt(np.nanmean(before.train.torque**2, axis=0))
    share = torque_share(torque, np.maximum(scale, 1e-300))
    joint = int(np.argmax(share))
    after = result.prediction.held_out.residual[:, joint]
    odds = min(NATS * fault.measures["gain"] - float(np.log(len(list(EFFECTS)))), MOST_LOG_ODDS)
    finding = Finding(
        law=Law(effect, joints, value),
        std={key: fault.measures[f"std_{key}"] for key in "xyz"},
        role="cause",
        probability=float(1 / (1 + np.exp(-odds))),
        torque_share=share,
        where=locate(dataset.table, joint, torque[joint], bool(given.robot.prismatic[joint]), VARIABLES[:-1]),
        statistic=odds,
        threshold=FIRST_LOG_ODDS,
        held_out_gain=1 - float(np.nanmean(after**2) / np.nanmean(before.held_out.residual[:, joint] ** 2)),
        alternatives=(),
        stated=stated,
        in_model=bool(np.allclose(result.prediction.model.robot.model.gravity.linear, list(value.values()))),
    )
    verdict = "unknown" if result.verdict == "unknown" else "named"
    flags = (*result.flags, *(() if any(value.values()) else (WEIGHTLESS,)))
    return result._replace(verdict=verdict, findings=(finding, *result.findings), flags=flags)
