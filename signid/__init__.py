"""Identify a robot's dynamics from recordings, and find the physics that a simulation of it lacks.

Start with `load_robot` and `read_recording`. `identify` estimates a model with confidence intervals, `diagnose` names
the effects that a simulation (`load_model`) lacks. Units are SI, errors derive from `SignidError`.
"""

from typing import TYPE_CHECKING  # isort: skip_file
from .registry import become_package as _become_package
from .version import __version__ as __version__

if TYPE_CHECKING:
    from .robot import load_robot as load_robot
    from .recording import read_recording as read_recording
    from .identify import identify as identify
    from .diagnose import diagnose as diagnose
    from .simulation.plant import simulate as simulate
    from .validate import validate as validate
    from .check import check as check
    from .check import inspect as inspect
    from .model import load_model as load_model
    from .simulation.plant import Sensors as Sensors, record as record, track as track
    from .simulation.excite import excite as excite, separate as separate
    from .simulation.rollout import roll_out as roll_out
    from .payload import payload as payload, with_payload as with_payload
    from .servo.identify import identify_servos as identify_servos
    from .servo.diagnose import diagnose_servos as diagnose_servos
    from .servo.simulate import simulate_servos as simulate_servos
    from .servo.validate import validate_servos as validate_servos
    from .watch import watch as watch
    from .output.export import export as export
    from .output.report import report as report
    from .output.replay import replay as replay
    from .output.viewers import viewer_log as viewer_log
    from .robot import urdf_from_dh as urdf_from_dh
    from .cli.fleet.run import fleet as fleet
    from .deadline import time_limit as time_limit
    from .regression.session import Options as Options
    from .errors import SignidError as SignidError

NAMES = _become_package(__name__)
