"""Real robots: false contacts of unloaded streams, and loads that are put on, of a UR10e and a Panda.

UR10e: every recording is watched with models of others (Mamedov, Mikhel, 2020), by itself and one after another with
pauses; then the loaded recording follows an unloaded one from several of its moments. Panda: one recording, whose model
is that of itself (Gaz et al., 2019).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

import signid
from signid.model import Model
from signid.types import Array
from signid.watch import Contact, LastingChange

from ..real_data import LOADED, recording, ur10e, ur10e_recording
from ..summary import data

FOURIER = (
    "20_01_31_unload",
    "20_02_10_30sec_12harm",
    "20_02_12_40sec_12harm",
    "20_02_12_50sec_12harm",
    "20_02_19_14harm50sec",
)
OTHERS = (
    ("validation_data", "20_01_17_ptp_10_points"),
    *(("jointwise_motion", f"20_01_22_joint_{k}") for k in range(1, 7)),
)
MODELS = ((4, 1), (0,), (3,), (2, 1))  # of FOURIER
PAUSE = 0.5  # [s] between recordings
OFFSETS = (0.0, 12.0, 24.0)  # [s] in the loaded recording
MASS = 2.805  # [kg] by the scale
PROMPT = 10.0  # [s] within which a load should be named


class Stream(NamedTuple):
    """False alarms of one unloaded stream."""

    robot: str
    seconds: float
    false: int


class Load(NamedTuple):
    """Answer to a load that was put on."""

    named: bool  # first, within `PROMPT`
    after: float  # [s]
    mass: float  # [kg] of the first event
    width: float  # [kg] half of its 95 % interval
    corrected: float  # [kg] of the second one
    narrower: float  # [kg] half of its 95 % interval
    later: int  # contacts after it was named


def _spliced(samples: Sequence[Any], speeds: bool) -> tuple[dict[str, Array], float]:
    """Columns of samples one after another, and the time of the last begin [s]."""
    parts: dict[str, list[Array]] = {}
    end = begin = 0.0
    for one, rows in samples:
        begin = end
        t = one.t[rows] - one.t[rows][0] + begin
        signals = {"q": one.q[rows], "tau": one.tau[rows], **({"dq": one.dq[rows]} if speeds else {})}
        parts.setdefault("t", []).append(t)
        for key, values in signals.items():
            for j, column in enumerate(values.T):
                parts.setdefault(f"{key}_{j + 1}", []).append(column)
        end = float(t[-1]) + PAUSE
    return {key: np.concatenate(x) for key, x in parts.items()}, begin


def _alarms(model: Model, columns: Mapping[str, Array]) -> int:
    found = signid.watch(model, columns)
    return sum(isinstance(e, LastingChange) or (isinstance(e, Contact) and e.end is None) for e in found)


def _ur10e_models() -> Iterator[tuple[Model, list[Any]]]:
    """Models, and the samples of the recordings that each has not seen."""
    whole = slice(None)
    for chosen in MODELS:
        model = signid.identify(ur10e(), [ur10e_recording(FOURIER[k]) for k in chosen]).model
        yield model, [(ur10e_recording(FOURIER[k]).read(), whole) for k in range(len(FOURIER)) if k not in chosen]


def unloaded() -> list[Stream]:
    """Unloaded streams of the UR10e with and without its speeds, and of the Panda."""
    out = list[Stream]()
    for model, fourier in _ur10e_models():
        others = [(ur10e_recording(name, group).read(), slice(None)) for group, name in OTHERS]
        for samples in ([fourier], [[one] for one in (*fourier, *others)]):
            for some in samples:
                for speeds in (True, False):
                    columns, _ = _spliced(some, speeds)
                    out.append(Stream("ur10e", float(columns["t"][-1]), _alarms(model, columns)))
    robot = signid.load_robot(data() / "panda_gaz2019" / "panda.urdf")
    given = recording("panda_gaz2019", "exciting_traj_1", robot)
    model = signid.identify(robot, [given]).model
    for speeds in (True, False):
        columns, _ = _spliced([(given.read(), slice(None))], speeds)
        out.append(Stream("panda", float(columns["t"][-1]), _alarms(model, columns)))
    return out


def loads() -> list[Load]:
    """The load of the UR10e after each unloaded recording, at several moments, with and without speeds."""
    loaded, out = ur10e_recording(LOADED).read(), list[Load]()
    for model, fourier in _ur10e_models():
        for before in fourier:
            for offset in OFFSETS:
                for speeds in (True, False):
                    rows = loaded.t - loaded.t[0] >= offset
                    columns, begin = _spliced([before, (loaded, rows)], speeds)
                    out.append(_answer(model, columns, begin))
    return out


def _answer(model: Model, columns: Mapping[str, Array], begin: float) -> Load:
    found = [e for e in signid.watch(model, columns) if e.t >= begin]
    changes = [e for e in found if isinstance(e, LastingChange)]
    if not changes or changes[0].law != "payload":
        return Load(False, *(float("nan"),) * 5, later=0)
    first, rest = changes[0], changes[1:]
    better = next((e for e in rest if e.corrects == first.t), first)
    later = sum(isinstance(e, Contact) and e.end is None and e.t > first.t for e in found)
    numbers = [x for e in (first, better) for x in (e.parameters["mass"], 1.96 * e.std["mass"])]
    return Load(first.t - begin <= PROMPT, first.t - begin, *numbers, later=later)
