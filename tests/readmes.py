"""The READMEs of the tree: their fenced blocks, inline code and links."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
ROOMS = sorted(path.relative_to(ROOT).as_posix() for path in (ROOT / "signid").rglob("*.md"))
READMES = ("README.md", "robots/README.md", "benchmarks/README.md", *ROOMS)
TEXTS = {path: (ROOT / path).read_text(encoding="utf-8") for path in READMES}
FENCED = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


class Block(NamedTuple):
    """A fenced block of a README."""

    path: str
    kind: str  # "sh", "python", "csv", ...; empty for an extract
    text: str

    def commands(self) -> list[list[str]]:
        """Arguments of the signid commands that the block shows."""
        lines = self.text.replace("\\\n", "").splitlines()
        shown = [line.removeprefix("$ ") for line in lines if self.kind == "sh" or line.startswith("$ ")]
        return [line.split()[1:] for line in shown if line.startswith("signid ")]


def blocks(kind: str | None = None) -> list[Block]:
    """Blocks of one kind, or of every kind, in all READMEs."""
    found = (Block(path, *match) for path, text in TEXTS.items() for match in FENCED.findall(text))
    return [block for block in found if kind in (None, block.kind)]


def inline(path: str) -> list[str]:
    """Code in single backticks, line breaks as spaces."""
    text = FENCED.sub("", TEXTS[path])
    return [" ".join(code.split()) for code in re.findall(r"`([^`]+)`", text)]


def links(path: str) -> Iterator[tuple[Path, str]]:
    """File and anchor of each relative link."""
    for target in re.findall(r"\]\((?!https?:)([^)\s]+)\)", FENCED.sub("", TEXTS[path])):
        file, _, anchor = target.partition("#")
        yield ((ROOT / path).parent / file).resolve() if file else ROOT / path, anchor


def anchors(path: str) -> set[str]:
    """Anchors of the headings of a README, as Git hosts derive them."""
    headings = re.findall(r"^#+ (.+)$", FENCED.sub("", TEXTS[path]), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}
