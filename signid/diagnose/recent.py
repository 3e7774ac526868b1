"""What was asked lately is not computed again."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import Generic, TypeVar

Answer = TypeVar("Answer")


class Recent(Generic[Answer]):
    """Some answers, kept until there are too many of them."""

    def __init__(self, most: int) -> None:
        self.most, self.kept = most, dict[Hashable, Answer]()

    def __call__(self, key: Hashable, make: Callable[[], Answer]) -> Answer:
        """The answer to a question, made where it is not kept."""
        if key not in self.kept:
            if len(self.kept) == self.most:
                self.kept.clear()
            self.kept[key] = make()
        return self.kept[key]
