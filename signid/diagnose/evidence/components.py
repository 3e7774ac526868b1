"""Connected components of joints: fits of different components are independent."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from ..data.column_groups import Group
from ..data.whitened_rows import Whitened


class Component(NamedTuple):
    """Joints, and the groups that act on them and on no others."""

    joints: tuple[int, ...]
    refitted: tuple[Group, ...]  # nuisance terms
    selected: tuple[Group, ...]  # selected hypotheses

    @property
    def groups(self) -> tuple[Group, ...]:
        """All fitted groups."""
        return (*self.refitted, *self.selected)


def connected_components(
    data: Whitened, refitted: Sequence[Group], selected: Sequence[Group], coupled: Sequence[Group] = ()
) -> tuple[Component, ...]:
    """Find the connected components: two joints are in one if a group acts on both; groups keep their order.

    For a few dozen groups this takes a fifth of the time of scipy.sparse.csgraph.connected_components, or less.

    Args:
        data: whitened rows.
        refitted: nuisance terms.
        selected: selected hypotheses.
        coupled: groups that are coupled with each other by a prior.
    """
    # a group that acts on no joint is fitted with the first
    rows = {group: data.rows(group) or [0] for group in (*refitted, *selected)}
    label = list(range(data.joints))
    for joints in (*rows.values(), [j for group in coupled for j in rows[group]]):
        first, *others = sorted({label[j] for j in joints}) or [0]
        if others:
            label = [first if one in others else one for one in label]

    def within(groups: Sequence[Group], one: int) -> tuple[Group, ...]:
        return tuple(group for group in groups if label[rows[group][0]] == one)

    return tuple(
        Component(
            tuple(j for j, other in enumerate(label) if other == one), within(refitted, one), within(selected, one)
        )
        for one in sorted(set(label))
    )
