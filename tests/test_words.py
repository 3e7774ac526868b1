"""One language: terms that are no terms of the field do not come back into code, texts and pages.

Each pattern stands beside the words to use instead; a line that needs such a word says it otherwise.
"""

from __future__ import annotations

import re
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
ALLOWED = {  # old module names, JSON keys, a method of another package
    ("CHANGELOG.md", "signid.gross"),
    ("CHANGELOG.md", "`gross`"),
    ("CHANGELOG.md", "`told_by`"),
    ("CHANGELOG.md", "`not_told`"),
    ("tests/test_servo_output.py", '"told_by"'),
    ("tests/test_servo_output.py", '"not_told"'),
}
INSTEAD = {
    r"\b(?:un)?told\b|\b_?tell(?:s|ing)?\b|_told\b|\btold_": "say, show, give, print; identifiable; distinguish",
    r"\btaken for true\b": "selected",
    r"\bforetell\w*": "predict",
    r"\bwhat is left\b": "residual, remainder",
    r"\bwhen all was well\b": "healthy reference",
    r"\bwritten down\b": "measured, recorded",
    r"\bso man(?:y|ieth)\b": "a number; every n-th",
    r"\bgross\b": "recording fault",
    r"\bnothing more\b": "no further effect",
    r"\bnought\b": "zero",
    r"\bunforeseen\b": "irreducible std",
    r"\bof the record\b": "of the recording, of the measurement",
    r"\bbeliev\w*|\bbelief\w*": "prior, assume",
    r"\bdoubt\w*": "warning, uncertain, suspect",
    r"\bduel\b": "discriminate",
    r"\bstrain(?:ed)?\b": "inertial violation",
    r"\bas it were\b|\bgo(?:es)? astray\b|\bbeforehand\b|\bwhatsoever\b": "plain words",
}
ANY = re.compile("|".join(INSTEAD), re.IGNORECASE)
BEGINNING = re.compile(r'^\s*(?:#|//|\w+: |r?""")\s*(?:Of|That)\b|"""What\b')  # no sentence begins so
KINDS = {".py", ".md", ".js", ".html", ".css", ".jinja2"}


def files() -> list[Path]:
    """Every text of the repository but this file."""
    try:
        run = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("not a git checkout: which files belong to the repository is unknown")
    named = [ROOT / name for name in run.stdout.split("\0") if name]
    return [path for path in named if path.suffix in KINDS and path.is_file() and path != Path(__file__)]


def violations(text: str) -> Iterator[str]:
    """Each line with a term that is replaced, and what replaces it."""
    for i, line in enumerate(text.splitlines(), 1):
        if found := ANY.search(line):
            instead = next(
                words for pattern, words in INSTEAD.items() if re.fullmatch(pattern, found[0], re.IGNORECASE)
            )
            yield f"{i}: {found[0]!r}: {instead}"
        if found := BEGINNING.search(line):
            yield f"{i}: {found[0].strip()!r}: begin with a subject, a verb or a noun phrase"


def test_the_vocabulary_is_that_of_the_field() -> None:
    found = []
    for path in files():
        name, text = path.relative_to(ROOT).as_posix(), path.read_text("utf-8")
        for word in (word for file, word in ALLOWED if file == name):
            text = text.replace(word, "")
        found += [f"{name}:{line}" for line in violations(text)]
    assert not found, "\n" + "\n".join(found)


def test_planted_terms_are_caught() -> None:
    for text in (
        "what the motion tells",
        "# Of a robot",
        '"""What is left.',
        "it foretells",
        "laws taken for true",
        "Told",
    ):
        assert list(violations(text)), text
    assert not list(violations('"""Residual of the model: measured - predicted torque [N.m]."""'))
