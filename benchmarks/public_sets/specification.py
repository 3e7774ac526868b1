"""Specifications of IdentiBench for the sets of a folder: `specifications(folder)`.

Inputs are filtered q, dq and ddq, the output is the measured torque of each joint (inverse dynamics). The task
low-passes and decimates prediction and measurement, and evaluates the rows where the joint moves: rms of each joint,
and as headline their geometric mean over the rms of least squares. This file needs IdentiBench alone, not signid.
Licence of this file: BSD-3-Clause, as signid; the recordings have their own.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Single = NDArray[np.float32]
Mask = NDArray[np.bool_]
Model = Callable[[Any, Any, dict[str, Any]], Any]  # u (N, 3 n), y_init (0, n), attributes of the file -> torque (N, n)
MISSING = "identibench is not installed; run pip install identibench==0.4.0"
DESCRIPTION = "set.json"
HEADLINE = "rms_over_least_squares"


class Channels(NamedTuple):
    """Names of the columns in the files."""

    u: list[str]  # q, dq, ddq [rad or m, and per s, s2] of all joints
    y: list[str]  # torque [N.m or N]
    counts: list[str]  # 1 where a row counts


class Rows(NamedTuple):
    """Low-pass of the rows and the rows that count."""

    taps: Array  # (k,) [1]
    factor: int  # samples per row
    counts: Mask  # (M, n)

    def __call__(self, signal: Array | Single) -> Array:
        """Rows (M, n) of a signal (N, n) [any unit]; the first is centred on sample k // 2.

        Args:
            signal: samples of one file, such as a torque.
        """
        columns = [np.correlate(x, self.taps, "valid")[:: self.factor] for x in np.asarray(signal, float).T]
        return np.column_stack(columns)


def channels(joints: Iterable[str]) -> Channels:
    """Names of the columns.

    Args:
        joints: names of the moving joints.
    """
    own = [x.replace("/", "_") for x in joints]
    moved = [f"{key}_{x}" for key in ("q", "dq", "ddq") for x in own]
    return Channels(moved, [f"tau_{x}" for x in own], [f"counts_{x}" for x in own])


@dataclass(frozen=True)
class TorqueRows:
    """Task: rms of torque on the filtered rows, over all files of a test set. The initial window is empty."""

    joints: tuple[str, ...]
    least_squares_rms: tuple[float, ...]  # [N.m or N] per joint, on the same rows
    init_window: int = 0  # samples of torque that the model gets: none, because torque follows from the motion

    def __call__(self, spec: Any, model: Model) -> Any:
        """Evaluate a model on every test set; the result is IdentiBench's.

        Args:
            spec: specification of the set.
            model: u, y_init, attributes -> torque.
        """
        from identibench.benchmark import EvalResult

        scores = {}
        for name, paths in spec.test_set_files().items():
            rms = pooled_rms(self._residual(path, model) for path in paths)
            each = {f"rms_{joint}": float(x) for joint, x in zip(self.joints, rms, strict=True)}
            scores[name] = {HEADLINE: relative(rms, self.least_squares_rms), **each}
        return EvalResult(scores=scores, headline=(next(iter(scores)), HEADLINE))

    def _residual(self, path: Path, model: Model) -> tuple[Array, Mask]:
        """Rows (M, n) of measured - predicted torque [N.m or N], and those that count."""
        u, y, rows, attributes = read(path, self.joints)
        predicted = np.asarray(model(u, y[: self.init_window], attributes), float)
        if predicted.shape != y.shape:
            raise ValueError(f"the model returns shape {predicted.shape}; {path.name} needs {y.shape}")
        return rows(y - predicted), rows.counts


def read(path: Path, joints: Iterable[str]) -> tuple[Single, Single, Rows, dict[str, Any]]:
    """Read inputs (N, 3 n), torque (N, n) [N.m or N], rows and attributes of a file; in single precision.

    Args:
        path: HDF5 file.
        joints: names of the moving joints.
    """
    import h5py

    named = channels(joints)
    with h5py.File(path, "r") as file:
        u, y = (np.stack([file[x][()] for x in own], axis=-1).astype(np.float32) for own in (named.u, named.y))
        counts = np.stack([file[x][()] for x in named.counts], axis=-1).astype(bool)
        rows = Rows(file["taps"][()], int(file.attrs["factor"]), counts)
        return u, y, rows, dict(file.attrs)


def pooled_rms(parts: Iterable[tuple[Array, Mask]]) -> Array:
    """Rms (n,) over the rows of all files that count [N.m or N]; NaN without any, or if one of them is NaN.

    Args:
        parts: residual (M, n) [N.m or N] and mask (M, n) of each file.
    """
    rest, counts = (np.concatenate(x) for x in zip(*parts, strict=True))
    pairs = zip(rest.T, counts.T, strict=True)
    return np.asarray([np.sqrt(np.mean(x[own] ** 2)) if own.any() else np.nan for x, own in pairs])


def relative(rms: Iterable[float], reference: Iterable[float]) -> float:
    """Geometric mean over joints of rms over the rms of least squares [1]; a joint without rows does not count.

    Args:
        rms: rms [N.m or N] per joint.
        reference: the same of least squares.
    """
    pairs = [(x, y) for x, y in zip(rms, reference, strict=True) if np.isfinite(y) and y > 0]
    with np.errstate(divide="ignore"):
        return float(np.exp(np.mean([np.log(x / y) for x, y in pairs])))


def specifications(folder: Path | str) -> dict[str, Any]:
    """Specifications of IdentiBench by set, for `identibench.run_benchmark`.

    Args:
        folder: folder that `python -m benchmarks.public_sets` has filled; its place is free.

    Raises:
        ImportError: IdentiBench is not installed.
        FileNotFoundError: the folder holds no set.
    """
    try:
        import identibench  # noqa: F401
    except ImportError as error:
        raise ImportError(MISSING) from error
    found = sorted(Path(folder).glob(f"*/{DESCRIPTION}"))
    if not found:
        raise FileNotFoundError(f"{folder} holds no set; run python -m benchmarks.public_sets {folder}")
    made = [_specification(path.parent) for path in found]
    return {spec.name.removeprefix("signid_"): spec for spec in made}


def _specification(folder: Path) -> Any:
    from identibench import BenchmarkSpec, Dataset

    class Here(Dataset):
        """A data set in a given folder, in place of IDENTIBENCH_DATA_ROOT."""

        path = folder.resolve()

    known = json.loads((folder / DESCRIPTION).read_text(encoding="utf-8"))
    place, named = Here(f"signid_{known['name']}", prepare=None), channels(known["joints"])
    files = {part: [(place, f"{part}/{x}") for x in own] for part, own in known["files"].items()}
    reference = (np.nan if x is None else float(x) for x in known["least_squares_rms"])
    return BenchmarkSpec(
        name=f"signid_{known['name']}",
        u_cols=named.u,
        y_cols=named.y,
        train=files["train"],
        valid=files["valid"],
        test_sets={"test": files["test"]},
        task=TorqueRows(tuple(known["joints"]), tuple(reference)),
    )
