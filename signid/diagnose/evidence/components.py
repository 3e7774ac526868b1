"""What is fitted together -> joints that it couples: what is fitted to others does not matter to them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from ..data.column_groups import Group
from ..data.whitened_rows import Whitened


class Component(NamedTuple):
    """Joints, and what is fitted to them and to no others."""

    joints: tuple[int, ...]
    refitted: tuple[Group, ...]
    selected: tuple[Group, ...]  # selected hypotheses

    @property
    def groups(self) -> tuple[Group, ...]:
        """All that is fitted."""
        return (*self.refitted, *self.selected)


def split(
    data: Whitened, refitted: Sequence[Group], selected: Sequence[Group], coupled: Sequence[Group] = ()
) -> tuple[Component, ...]:
    """Connected components: two joints are in one if some group acts on both; groups keep their order.

    Args:
        data: tells on which joints a group acts.
        refitted: what is refitted.
        selected: selected hypotheses.
        coupled: groups among which something else than rows couples each with each.
    """
    rows = {
        group: data.rows(group) or [0] for group in (*refitted, *selected)
    }  # what acts on none is fitted all the same
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
