"""Test setup: one thread, deterministic examples and the path of the real recordings."""

from __future__ import annotations

import os
import sys
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before anything imports numpy
os.environ.setdefault("OMP_NUM_THREADS", "1")
sys.dont_write_bytecode = False  # else every worker and every command in a process of its own compiles all anew
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

import pytest  # noqa: E402
from hypothesis import settings  # noqa: E402

settings.register_profile("signid", derandomize=True, deadline=None, max_examples=30, database=None)
settings.load_profile("signid")


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Let one worker run a file, or files of a common `xdist_group`: what they share is then made once."""
    for item in items:
        if item.get_closest_marker("xdist_group") is None:
            item.add_marker(pytest.mark.xdist_group(item.path.stem))


@pytest.fixture(scope="session")
def data() -> Path:
    """The folder of real recordings."""
    folder = os.environ.get("SIGNID_DATA")
    if not folder:
        pytest.skip("SIGNID_DATA is unset: real recordings are not part of the repository")
    return Path(folder)
