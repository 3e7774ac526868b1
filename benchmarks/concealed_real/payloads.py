"""Payload at the last link, in a model or in the torque of a recording."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from signid.model import Model, stated_inertials
from signid.recording.sampling import samples
from signid.regression.motion import build_motion
from signid.regression.session import Options, prepare
from signid.robot.dynamics import own_body
from signid.types import Recording

from .band import Array
from .changes import with_body
from .sets import rebuilt

SHARE, PLACE, RADIUS = 0.1, (0.05, 0.02, 0.1), 0.05  # mass over the robot's mass [1], centre [m], radius [m]
WIDER = 3.0  # cut-off of the accelerations over that of the diagnosis [1]


def load_of(model: Model) -> Array:
    """Inertial parameters (10,) about the last joint's frame of a ball with a tenth of the robot's mass.

    Args:
        model: simulation model; the smaller of its stated and identified masses counts.
    """
    stated = stated_inertials(model.robot)[-1]
    place = np.array(PLACE) if len(model.robot.joints) > 1 else stated[1:4] / stated[0]
    ball = pin.Inertia(1.0, place, 0.4 * RADIUS**2 * np.eye(3)).toDynamicParameters()
    mass = min(float(x[:, 0].sum()) for x in (model.inertials, stated_inertials(model.robot)))
    return np.asarray(SHARE * mass * ball)


def carrying(recording: Recording, model: Model, load: Array | None, cutoff: float) -> Recording:
    """Add the torque of a body at the last link to a recording; cut the ends, where acceleration is unknown.

    Args:
        recording: recording without the body.
        model: model of the robot.
        load: inertial parameters of the body (10,); None: the same rows without the body.
        cutoff: cut-off of the diagnosis [Hz].
    """
    session = prepare(model.robot, [recording], [recording], Options(effects=(), cutoff=WIDER * cutoff))
    given, sampling = session.held_out[0]
    span = max(sampling.spans, key=sampling.length)
    window = samples(given, sampling, span, 0, sampling.length(span))
    motion = build_motion(model.robot, window, session.task.band, sampling.period)
    edge = (len(window.t) - len(motion)) // 2
    inside = slice(edge, edge + len(motion))
    tau = window.tau[inside]
    if load is not None:
        loaded = with_body(model, own_body(model.robot, len(model.robot.joints) - 1), load)
        bare = motion[:]
        tau = tau + loaded.inverse(bare) - model.inverse(bare)
    more = {key: getattr(window, key) for key in ("dq", "ddq", "q_des")}
    rows = {key: x[inside] for key, x in more.items() if x is not None}
    return rebuilt(model.robot, {"t": motion.t, "q": window.q[inside], "tau": tau, **rows})
