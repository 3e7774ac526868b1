"""signid: what a real robot's dynamics are, from its recordings, and what a simulation of it lacks.

`load_robot` and `read_recording` begin. `check` says what recordings can tell, `identify` makes a model of them, with
intervals, `diagnose` names the physics that a simulation (`load_model`) lacks, `payload` what a robot carries; `fleet`
is for many. `validate` and `roll_out` judge models, `report` and `replay` show them, `export`, `excite` and `simulate`
use them. Units are SI; `(N, n) [rad or m]`: N samples of n joints. Errors are `SignidError`, laws `signid.effects`.
"""

import sys
from typing import TYPE_CHECKING

from .registry import package as _package
from .version import __version__ as __version__

if TYPE_CHECKING:
    from .check import check as check
    from .deadline import time_limit as time_limit
    from .diagnose import diagnose as diagnose
    from .errors import SignidError as SignidError
    from .excite import excite as excite, separate as separate  # isort: skip
    from .export import export as export
    from .fleet import fleet as fleet
    from .identify import identify as identify
    from .inspect import inspect as inspect
    from .model import load_model as load_model
    from .payload import payload as payload
    from .recording import read_recording as read_recording
    from .reduced import encode_factors as encode_factors, load_factors as load_factors, reduce as reduce  # isort: skip
    from .replay import replay as replay
    from .report import report as report
    from .robot import load_robot as load_robot, urdf_from_dh as urdf_from_dh  # isort: skip
    from .rollout import roll_out as roll_out
    from .session import Options as Options
    from .simulate import Sensors as Sensors, record as record, simulate as simulate, track as track  # isort: skip
    from .validate import validate as validate
NAMES = {n: n for n in "check diagnose export fleet identify inspect payload replay report validate".split()} | {
    "deadline": "time_limit", "errors": "SignidError", "excite": "excite separate", "model": "load_model",
    "rollout": "roll_out", "reduced": "encode_factors load_factors reduce", "robot": "load_robot urdf_from_dh",
    "session": "Options", "recording": "read_recording", "simulate": "Sensors record simulate track"}  # fmt: skip
sys.modules[__name__].__class__ = _package(NAMES)
