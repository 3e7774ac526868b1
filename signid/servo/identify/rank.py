"""Null space of the information matrix: numbers that only appear in combination."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...parameters import Array

Name = tuple[str, str]  # joint, number

RANK = 1e-9  # eigenvalue of the normalised information, relative to 1, below which a direction is not identifiable
MEMBER = 0.1  # component of a unit direction beyond which a number belongs to it


def dependent_numbers(information: Array, names: Sequence[Name]) -> tuple[tuple[Name, ...], ...]:
    """Sets of numbers that the recordings identify only in combination, one for each direction without information.

    information: (P, P) of the numbers `names`; its scale and units do not matter. A number without any information
    stands alone in its set.
    """
    size = np.sqrt(np.maximum(np.diag(information), 0.0))
    alone = size <= RANK * max(float(size.max(initial=0.0)), 1e-300)
    found = [(names[k],) for k in np.flatnonzero(alone).tolist()]
    kept = np.flatnonzero(~alone)
    if len(kept):
        normal = information[np.ix_(kept, kept)] / np.outer(size[kept], size[kept])
        values, vectors = np.linalg.eigh((normal + normal.T) / 2)
        for vector in vectors.T[values < RANK * max(1.0, float(values[-1]))]:
            found.append(tuple(names[k] for k in kept[np.abs(vector) > MEMBER].tolist()))
    return tuple(found)


def sentences(sets: Sequence[Sequence[Name]]) -> tuple[str, ...]:
    """One sentence for each set of `dependent_numbers`."""
    said = []
    for members in sets:
        listed = ", ".join(f"{number.replace('_', ' ')} of {joint}" for joint, number in members)
        if len(members) == 1:
            said.append(f"{listed} does not act in these recordings, so it is not identifiable")
        else:
            said.append(f"{listed} are identifiable only in combination; state one of them")
    return tuple(said)
