"""Convert source files to the text of a recording or a URDF, reproducibly on all machines."""

from __future__ import annotations

import io
import re
from collections.abc import Mapping

import numpy as np

from ...types import Array

DIGITS = 9  # significant digits of numbers


def read_numbers(raw: bytes, skip: int = 0) -> Array:
    """Numbers (rows, columns) of a text [units of the source].

    Args:
        raw: comma-separated text.
        skip: number of header lines.

    Raises:
        ValueError: the text is not a table of numbers.
    """
    lines = raw.split(b"\n", skip)[skip:]
    if not lines or not lines[0].strip():
        raise ValueError("it contains no numbers")
    return np.loadtxt(io.BytesIO(lines[0]), delimiter=",", ndmin=2)


def read_matrix(raw: bytes, name: str) -> Array:
    """Variable of a MATLAB file, (rows, columns) [unit of the source]."""
    from scipy.io import loadmat

    return np.asarray(loadmat(io.BytesIO(raw), variable_names=[name])[name], np.float64)


def by_joint(kind: str, values: Array) -> dict[str, Array]:
    """Split a matrix into the columns KIND_1, KIND_2, ...

    Args:
        kind: kind of the columns, such as q or tau.
        values: (N, n) [unit of the kind].
    """
    return {f"{kind}_{j + 1}": column for j, column in enumerate(values.T)}


def write_table(columns: Mapping[str, Array], digits: int = DIGITS) -> str:
    """CSV text with a header and one line per sample.

    Args:
        columns: (N,) each, by name [units of the columns].
        digits: number of significant digits.
    """
    text = io.StringIO()
    text.write(",".join(columns) + "\n")
    np.savetxt(text, np.column_stack(list(columns.values())), fmt=f"%.{digits}g", delimiter=",")
    return text.getvalue()


def without_meshes(raw: bytes) -> str:
    """URDF text without visual and collision elements, whose meshes are not downloaded."""
    text = raw.decode("utf-8-sig").replace("\r\n", "\n")
    return re.sub(r"<(visual|collision)\b.*?</\1>", "", text, flags=re.DOTALL)
