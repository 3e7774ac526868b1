"""Fits before and after -> when the extended simulation is not to be trusted."""

from __future__ import annotations

from collections.abc import Iterator

from ...estimation.fit_quality import Fit

WORSE = 1.05  # times the rms before
LITTLE, LOUD = 0.5, 3.0  # held-out R2 below which torque is hardly predicted; irreducible rms from which on that counts


def holdout_warnings(before: Fit, after: Fit) -> Iterator[str]:
    """A sentence on each joint that is predicted worse than before, or hardly at all."""
    rows = zip(
        after.joints,
        after.unit,
        before.held_out_rms,
        after.held_out_rms,
        after.irreducible_rms,
        after.held_out_r2,
        strict=True,
    )
    for joint, unit, then, now, floor, r2 in rows:
        if now > WORSE * then and now > LOUD * floor:
            yield (
                f"the torque of {joint} on held-out recordings is predicted worse than before "
                f"({then:.3g} -> {now:.3g} {unit}): do not use the extended simulation for it"
            )
        elif r2 < LITTLE and now > LOUD * floor:
            yield (
                f"the extended simulation still predicts little of the torque of {joint} on held-out recordings "
                f"(R2 {r2:.2f}): what is missing there was not found"
            )
