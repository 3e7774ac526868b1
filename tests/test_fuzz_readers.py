"""Damaged and malicious files are read or refused with a message."""

from __future__ import annotations

import tempfile
import warnings
from pathlib import Path

import pytest
from damaged_files import TOKENS, Reader, readers
from hypothesis import given, settings, strategies as st

EXAMPLES, SLOW = 40, 4


@st.composite
def damaged(draw: st.DrawFn, seeds: tuple[bytes, ...]) -> bytes:
    """A file with bytes overwritten, removed, repeated, or inserted."""
    content = draw(st.sampled_from(seeds))
    for _ in range(draw(st.integers(1, 4))):
        start, length = draw(st.integers(0, len(content))), draw(st.integers(0, 40))
        stop = min(len(content), start + length)
        new = draw(st.one_of(st.sampled_from(TOKENS), st.binary(max_size=8), st.just(content[start:stop] * 3)))
        content = content[:start] + new + content[stop:]
    return content[: draw(st.one_of(st.just(len(content)), st.integers(0, len(content))))]


@pytest.mark.slow
@pytest.mark.parametrize("reader", readers(), ids=lambda reader: reader.name)
def test_damaged_files_are_read_or_refused(reader: Reader) -> None:
    @settings(max_examples=SLOW if reader.slow else EXAMPLES)
    @given(damaged(tuple(reader.seeds)))
    def check(content: bytes) -> None:
        with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
            warnings.simplefilter("ignore")
            reader(content, Path(folder))

    check()


@pytest.mark.slow_cases("metadata")
@pytest.mark.parametrize("reader", readers(), ids=lambda reader: reader.name)
def test_malicious_files_are_refused_and_intact_ones_read(reader: Reader, tmp_path: Path) -> None:
    for token in () if reader.slow else (b"", b"\0", *TOKENS):
        read = reader(token, tmp_path)
        assert not read or reader.name in ("actuators", "columns", "bounds"), ("nothing is enough", token[:12])
    assert reader(reader.seeds[0], tmp_path)
