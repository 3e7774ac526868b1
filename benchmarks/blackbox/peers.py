"""figaroh and mujoco.sysid on the same data and rows, each in its own Python."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from ..concealed_real.sets import columns_of
from ..peers.ask import Peer
from ..plants.bodies import Body, bare
from .rows import Array, filtered
from .task import Answer, Task, UnavailableError, together

BRIDGE, EDGE = 2.0, 0.5  # excluded time between recordings and at both ends of each [s]


def ask(task: Task, peer: Peer, name: str) -> Answer:
    """Let a peer fit A and B and predict the torque of C at the samples of the rows.

    Args:
        task: data of the set.
        peer: peer in its own Python.
        name: name of the peer.

    Raises:
        UnavailableError: the peer is not installed or failed.
    """
    if not peer.version:
        raise UnavailableError(f"{name} is not installed; give --peer-python")
    if task.robot.kind != "urdf":
        raise UnavailableError(f"the description is {task.robot.kind}; {name} reads URDF only")
    rows = filtered(task.least_squares, task.c, task.cutoff)
    motions = [piece.motion for piece in rows.pieces]
    held_out = {f"held_out_{key}": np.concatenate([getattr(x, key) for x in motions]) for key in "qva"}
    with TemporaryDirectory() as place:
        folder = Path(place)
        urdf = bare(Body(task.robot.document, task.joints))
        (folder / "robot.urdf").write_text(urdf, encoding="utf-8")
        np.savez(folder / "job.npz", **job(task), **held_out)
        answer = peer.ask(folder)
        if answer is None or "failed" in answer:
            raise UnavailableError(f"{name} failed: {(answer or {}).get('failed', 'no answer')}"[:200])
        predicted = np.load(folder / "predicted.npy")
    cuts = np.cumsum([len(x.q) for x in motions])[:-1]
    parts = zip(rows.pieces, np.split(predicted, cuts), strict=True)
    rest = np.concatenate([rows.thin(x.residual + np.asarray(x.motion.predicted) - own) for x, own in parts])
    return Answer(np.where(np.isnan(task.held_out.rest), np.nan, rest), float(answer["seconds"]), str(answer["note"]))


def job(task: Task) -> dict[str, Any]:
    """Arrays for the peers: concatenated recordings with bridges, and their filtered rows.

    Args:
        task: data of the set.
    """
    columns, step = [columns_of(x) for x in together(task)], task.fitted.period
    signals = [uniform(x, step) for x in columns]
    long, edge = round(BRIDGE / step), round(EDGE / step)
    q, tau, counts = [], [], []
    for k, (position, torque) in enumerate(signals):
        if k:
            q.append(bridge(signals[k - 1][0][-1], position[0], long))
            tau.append(bridge(signals[k - 1][1][-1], torque[0], long))
            counts.append(np.zeros(long, bool))
        own = np.arange(len(position))
        counts.append((own >= edge) & (own < len(position) - edge))
        q.append(position)
        tau.append(torque)
    n = len(task.joints)
    inside = [np.isfinite(x.rest).all(axis=1) for x in task.training]
    motion = np.concatenate([x.motion[own] for x, own in zip(task.training, inside, strict=True)])
    return {
        "joints": np.array(task.joints),
        "prismatic": np.array(task.least_squares.robot.prismatic),
        "t": step * np.arange(sum(map(len, q))),
        "q": np.concatenate(q),
        "tau": np.concatenate(tau),
        "counts": np.concatenate(counts),
        "cutoff": task.cutoff,
        "position_cutoff": task.fitted.position_cutoff,
        **{f"row_{key}": motion[:, k * n : (k + 1) * n] for k, key in enumerate("qva")},
        "row_tau": np.concatenate([x.torque[own] for x, own in zip(task.training, inside, strict=True)]),
    }


def uniform(columns: dict[str, Array], step: float) -> tuple[Array, Array]:
    """Resample positions and torques (N, n) at uniform times; interpolate gaps.

    Args:
        columns: t (N,), q (N, n), tau (N, n).
        step: time step [s].
    """
    t = columns["t"]
    at = np.arange(t[0], t[-1], step)
    found = []
    for key in ("q", "tau"):
        each = [(np.isfinite(x), x) for x in columns[key].T]
        found.append(np.column_stack([np.interp(at, t[own], x[own]) for own, x in each]))
    return found[0], found[1]


def bridge(start: Array, end: Array, samples: int) -> Array:
    """Smooth transition (samples, n) between two vectors, at rest at both ends to avoid filter ringing.

    Args:
        start: first vector (n,).
        end: last vector (n,).
        samples: number of samples.
    """
    x = np.arange(1, samples + 1) / (samples + 1)
    return np.asarray(start + (x**3 * (10 - 15 * x + 6 * x**2))[:, None] * (end - start))
