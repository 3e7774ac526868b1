"""From the files of a source to the text of a recording or a URDF, the same to the last digit on any machine."""

from __future__ import annotations

import io
import re
from collections.abc import Mapping

import numpy as np

from ...types import Array

DIGITS = 9


def read_numbers(raw: bytes, skip: int = 0) -> Array:
    """The numbers of a text, (rows, columns) [units of the source].

    Args:
        raw: the text; commas between numbers.
        skip: lines above them.

    Raises:
        ValueError: it is no table of numbers.
    """
    lines = raw.split(b"\n", skip)[skip:]
    if not lines or not lines[0].strip():
        raise ValueError("it holds no numbers")
    return np.loadtxt(io.BytesIO(lines[0]), delimiter=",", ndmin=2)


def read_matrix(raw: bytes, name: str) -> Array:
    """A variable of a MATLAB file, (rows, columns) [unit of the source]."""
    from scipy.io import loadmat

    return np.asarray(loadmat(io.BytesIO(raw), variable_names=[name])[name], np.float64)


def by_joint(kind: str, values: Array) -> dict[str, Array]:
    """Columns KIND_1, KIND_2, ...

    Args:
        kind: such as q or tau.
        values: (N, n) [unit of the kind].
    """
    return {f"{kind}_{j + 1}": column for j, column in enumerate(values.T)}


def write_table(columns: Mapping[str, Array], digits: int = DIGITS) -> str:
    """A header, and a line for each sample.

    Args:
        columns: (N,) each, by name [units of the columns of these names].
        digits: that numbers are rounded to.
    """
    text = io.StringIO()
    text.write(",".join(columns) + "\n")
    np.savetxt(text, np.column_stack(list(columns.values())), fmt=f"%.{digits}g", delimiter=",")
    return text.getvalue()


def without_meshes(raw: bytes) -> str:
    """A URDF without what only shows it: its meshes are not downloaded."""
    text = raw.decode("utf-8-sig").replace("\r\n", "\n")
    return re.sub(r"<(visual|collision)\b.*?</\1>", "", text, flags=re.DOTALL)
