"""What was asked lately is not computed again."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import Generic, TypeVar

Answer = TypeVar("Answer")


class Recent(Generic[Answer]):
    """The answers that were asked for last."""

    def __init__(self, most: int) -> None:
        self.most, self.kept = most, dict[Hashable, Answer]()

    def __call__(self, key: Hashable, make: Callable[[], Answer]) -> Answer:
        """The answer to a question, made where it is not kept."""
        answer = self.kept.pop(key) if key in self.kept else make()
        self.kept[key] = answer
        if len(self.kept) > self.most:
            del self.kept[next(iter(self.kept))]
        return answer
