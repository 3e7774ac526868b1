"""Archive of a file of factors: a JSON header and arrays, with a hash of all arrays."""

from __future__ import annotations

import json
from collections.abc import Mapping
from hashlib import sha256
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import numpy as np

from ...errors import OptionError
from ...recording.formats.npz import HEADER

SCHEMA = "signid.factors/1"
LARGEST, LARGEST_HEADER = 2**30, 2**24  # [bytes] size of all arrays and of the header: for damaged and malicious files


def read_archive(path: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """Header and arrays of an undamaged file of factors.

    Raises:
        OptionError: the file cannot be read, is damaged, or has another version.
    """
    if path.exists() and not path.is_file():
        raise OptionError(f"cannot read factors from {path}: it is no regular file")
    try:
        header, arrays = _unpacked(path)
        schema, whole = header["schema"], header["sha256"] == hash_of(arrays)
    except MemoryError:
        raise OptionError(
            f"{path} expands to more than {LARGEST >> 30} GiB, and factors are far smaller; reduce the recordings again"
        ) from None
    except Exception as error:  # errors of the system, of numpy, of zip archives and of the header's content
        if isinstance(error, OSError) and error.strerror:
            raise OptionError(f"cannot read factors from {path}: {error.strerror}") from None
        raise damaged(path) from error
    if schema != SCHEMA:
        raise OptionError(f"{path} holds {schema!r}; expected {SCHEMA!r}; reduce the recordings again")
    if not whole:
        raise damaged(path)
    return header, arrays


def _unpacked(path: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """Header and arrays of an archive of limited size."""
    with ZipFile(path) as archive:
        sizes = {member.filename: member.file_size for member in archive.infolist()}
        if sum(sizes.values()) > LARGEST or sizes.get(f"{HEADER}.npy", 0) > LARGEST_HEADER:
            raise MemoryError
    with np.load(path, allow_pickle=False) as archive:
        arrays = {name: archive[name] for name in archive.files}
    header = json.loads(arrays.pop(HEADER).tobytes())
    return header, arrays


def damaged(path: str | Path) -> OptionError:
    """Error about a file that is no file of factors."""
    return OptionError(
        f"{path} is not a file of factors as `signid reduce` writes it, or is damaged; reduce the recordings again"
    )


def hash_of(arrays: Mapping[str, Any]) -> str:
    """Hash of arrays by name."""
    digest = sha256()
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        digest.update(f"{name} {array.dtype.str} {array.shape}".encode() + array.tobytes())
    return digest.hexdigest()
