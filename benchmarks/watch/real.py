"""UR10e: unloaded stretches of other recordings, then the loaded one (Mamedov, Mikhel, 2020)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

import signid
from signid.watch import Contact, LastingChange

from ..real.data import HELD_OUT, LOADED, UNLOADED, ur10e_model, ur10e_recording

OTHERS = (HELD_OUT, "20_02_12_40sec_12harm", UNLOADED[0])  # unloaded; the last is of the day of the loaded one
MASS = 2.805  # [kg] by the scale
PAUSE = 0.5  # [s] between the recordings


class Splice(NamedTuple):
    """Answer of the watch to the spliced stream."""

    unloaded: float  # [s]
    false: int  # contacts and changes before the load
    named: str  # first change after it
    mass: float  # [kg]
    std: float  # [kg]
    after: float  # [s] since the load
    contact: float  # [s] since the load of the first contact
    later: int  # contacts after the change, in the rest of the recording


def splice(quiet: float = 10.0) -> Splice:
    """Play the recordings one after the other."""
    columns: dict[str, list[np.ndarray]] = {}
    end = begin = 0.0
    model = ur10e_model()
    n = len(model.robot.joints)
    for name in (*OTHERS, LOADED):
        samples = ur10e_recording(name).read()
        begin = end
        signals = {"t": samples.t - samples.t[0] + begin, "q": samples.q, "tau": samples.tau, "dq": samples.dq}
        for key, values in signals.items():
            columns.setdefault(key, []).append(np.asarray(values))
        end = float(signals["t"][-1]) + PAUSE
    whole = {key: np.concatenate(parts) for key, parts in columns.items()}
    flat = {"t": whole["t"]} | {f"{key}_{j + 1}": whole[key][:, j] for key in ("q", "tau", "dq") for j in range(n)}
    found = list(signid.watch(model, flat, quiet=quiet))
    alarms = [e for e in found if isinstance(e, LastingChange) or (isinstance(e, Contact) and e.end is None)]
    loaded = [e for e in alarms if e.t >= begin]
    change = next((e for e in loaded if isinstance(e, LastingChange)), None)
    touched = next((e.t - begin for e in loaded if isinstance(e, Contact)), float("nan"))
    mass, std = (
        (x.get("mass", np.nan) if change else np.nan for x in (change.parameters, change.std))
        if change
        else (np.nan, np.nan)
    )
    after = change.t if change else np.inf
    later = sum(isinstance(e, Contact) and e.t > after for e in loaded)
    return Splice(
        begin, len(alarms) - len(loaded), change.law if change else "", mass, std, after - begin, touched, later
    )
