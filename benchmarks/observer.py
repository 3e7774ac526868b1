"""Momentum observer in generated C at work: pushes and false contacts, beside the watch, and a real UR10e."""

from __future__ import annotations

import ctypes
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.signal import lfilter

import signid
from signid.model import Model
from signid.output.export import export
from signid.output.export.code.c import identifier
from signid.types import Array, Mask
from signid.watch import Contact

from .real.data import HELD_OUT, ur10e_model, ur10e_recording
from .watch.__main__ import REACTED, SETTLING, learnt, pushes, stream
from .watch.plant import Push

ROBOTS = ("panda", "ur10", "3r")
PUSHES, PART, PARTS = 40, 300.0, 4  # a robot; [s] of one quiet stream, streams
WINDOWS = (16, 8, 4)  # [rows of 1 ms] that give a velocity, all of the past
UR10E = (  # none of those that the model was fitted to; the first gives the thresholds
    ("identification_data", HELD_OUT),
    *(("identification_data", name) for name in ("20_02_12_40sec_12harm", "20_01_31_unload")),
    ("validation_data", "20_01_17_ptp_10_points"),
    *(("jointwise_motion", f"20_01_22_joint_{j}") for j in range(1, 7)),
)
LOOP = """#include "dynamics.h"
void observe(const double *rows, int *contact, int count, double quiet)
{
    static NAME_observer o;
    NAME_observer_reset(&o);
    NAME_observer_learn(&o, quiet);
    for (int k = 0; k < count; k++, rows += 3 * COUNT + 1, contact += COUNT + 1) {
        NAME_observer_step(&o, rows, rows + COUNT, rows + 2 * COUNT, rows[3 * COUNT]);
        for (int j = 0; j < COUNT; j++) {
            contact[j] = o.contact[j];
        }
        contact[COUNT] = o.learning;
    }
}
"""


class Rows(NamedTuple):
    """N rows of n joints."""

    t: Array  # (N,) [s]
    q: Array  # (N, n) [rad or m]
    v: Array  # (N, n) [rad/s or m/s]
    tau: Array  # (N, n) [N.m or N]


def observed(model: Model, rows: Rows, quiet: float = 10.0) -> tuple[Mask, float]:
    """Rows (N, n) at which joints are in contact, and the time [s] at which the thresholds were known."""
    made, n = export(model, "c", name="dynamics", functions=("observer",)), len(model.robot.joints)
    loop = LOOP.replace("NAME", identifier(model.robot.name)).replace("COUNT", str(n))
    dt = np.diff(rows.t, prepend=rows.t[0] - 1e-3)
    given = np.ascontiguousarray(np.column_stack([rows.q, rows.v, rows.tau, dt]))
    contact = np.zeros((len(given), n + 1), dtype=np.intc)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for file, text in {"dynamics.c": made.text, "dynamics.h": made.beside[".h"], "loop.c": loop}.items():
            (folder / file).write_text(text, encoding="utf-8")
        build = "cc -std=c99 -O2 -shared -fPIC dynamics.c loop.c -lm -o dynamics.so"
        subprocess.run(build.split(), cwd=folder, check=True)
        pointers = (x.ctypes.data_as(ctypes.c_void_p) for x in (given, contact))
        ctypes.CDLL(str(folder / "dynamics.so")).observe(*pointers, len(given), ctypes.c_double(quiet))
    return contact[:, :n] > 0, float(rows.t[np.flatnonzero(contact[:, n])[-1]])


def begun(rows: Rows, contact: Mask) -> Array:
    """Times (K,) [s] at which a first joint comes into contact."""
    any_joint = contact.any(axis=1)
    return np.asarray(rows.t[1:][any_joint[1:] & ~any_joint[:-1]])


def causal(columns: dict[str, Array], joints: int, window: int) -> Rows:
    """Rows with velocities by a line through the last positions, and torque through the filter that this is."""
    q, tau = (np.column_stack([columns[f"{key}_{j + 1}"] for j in range(joints)]) for key in ("q", "tau"))
    x = np.arange(window)[::-1] - (window - 1) / 2
    slope = x / np.sum(x**2)
    weights, t = np.cumsum(slope)[:-1], columns["t"]
    v = lfilter(slope, 1.0, q, axis=0) / np.mean(np.diff(t))
    return Rows(*(x[window:] for x in (t, lfilter(weights, 1.0, q, axis=0), v, lfilter(weights, 1.0, tau, axis=0))))


def planned(name: str, seed: int) -> list[Push]:
    """Random pushes of 0.3 s, 3 s apart, of 10 to 40 N at the outer half of the links."""
    n, rng = len(learnt(name)[1].joints), np.random.default_rng(seed)
    found = []
    for k in range(PUSHES):
        x, y, z = rng.standard_normal(3)
        scale = rng.uniform(10.0, 40.0) / np.linalg.norm([x, y, z])
        found.append(Push(20.0 + 3.0 * k, 0.3, int(rng.integers(n // 2, n)), (x * scale, y * scale, z * scale)))
    return found


def scored(times: Array, plan: Sequence[Push]) -> tuple[Array, int]:
    """Delays (K,) [s] of detected pushes, and the number of other contacts."""
    after = times[:, None] - np.array([push.start for push in plan])
    own = (after >= 0) & (after < REACTED + SETTLING)
    delays = np.where(own, after, np.inf).min(axis=0, initial=np.inf)
    return delays[delays < REACTED], int((~own.any(axis=1)).sum())


def main() -> int:
    """Print pushes, quiet streams, and the UR10e; 1 if the watch finds more pushes, or a simulated contact is false."""
    missed = 0
    for name in ROBOTS:
        model, plan = learnt(name)[2], planned(name, 5)
        n = len(model.robot.joints)
        columns = dict(stream(name, 20.0 + 3.0 * PUSHES, plan, 5))
        own = {window: causal(columns, n, window) for window in WINDOWS}
        scores = {window: scored(begun(rows, observed(model, rows)[0]), plan) for window, rows in own.items()}
        for window, (delays, false) in scores.items():
            _show(name, f"velocity of {window:2d} ms", delays, false)
        theirs = pushes(name, PUSHES, 5)
        _show(name, "watch", np.array(theirs.times), theirs.false)
        quiet = (causal(dict(stream(name, PART, (), seed)), n, WINDOWS[0]) for seed in range(PARTS))
        false = sum(len(begun(rows, observed(model, rows)[0])) for rows in quiet)
        print(f"{name:6s} {PARTS * PART / 60:.0f} min without pushes: {false} contacts", flush=True)
        missed += false + scores[WINDOWS[0]][1] + max(0, len(theirs.times) - len(scores[WINDOWS[0]][0]))
    unloaded()
    return int(missed > 0)


def unloaded() -> None:
    """Print contacts in recordings of an unloaded UR10e, one after the other."""
    parts, end = list[Rows](), 0.0
    for group, recording in UR10E:
        samples = ur10e_recording(recording, group).read()
        t = np.asarray(samples.t) - samples.t[0] + end
        parts.append(Rows(t, *(np.asarray(x) for x in (samples.q, samples.dq, samples.tau))))
        end = float(t[-1]) + 0.5
    rows = Rows(*map(np.concatenate, zip(*parts, strict=True)))
    for quiet in (10.0, 20.0):
        contact, learned = observed(ur10e_model(), rows, quiet)
        times = np.round(begun(rows, contact), 1).tolist()
        print(f"UR10e, {end / 60:.1f} min, thresholds after {learned:.0f} s: contacts at {times} s")
    events = signid.watch(ur10e_model(), {"t": rows.t, "q": rows.q, "tau": rows.tau, "dq": rows.v})
    print("UR10e, watch: contacts at", [round(e.t, 1) for e in events if isinstance(e, Contact) and e.end is None], "s")


def _show(name: str, how: str, delays: Array, false: int) -> None:
    late = 1e3 * np.median(delays)
    print(f"{name:6s} {how}: {len(delays)} of {PUSHES} pushes, after {late:.0f} ms; {false} false contacts")


if __name__ == "__main__":
    sys.exit(main())
