"""Test setup: one thread, deterministic examples and the path of the real recordings."""

from __future__ import annotations

import hashlib
import os
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before anything imports numpy
os.environ.setdefault("OMP_NUM_THREADS", "1")
sys.dont_write_bytecode = False  # else every worker and every command in a process of its own compiles all anew
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
ROOT = Path(__file__).resolve().parents[1]  # a loop that Numba keeps is not compiled again where what it calls changes
STAMP = hashlib.sha256(b"".join(path.read_bytes() for path in sorted((ROOT / "signid" / "servo").rglob("*.py"))))
os.environ.setdefault("NUMBA_CACHE_DIR", str(ROOT / ".pytest_cache" / f"numba-{STAMP.hexdigest()[:12]}"))
os.environ.pop("SIGNID_DEBUG", None)  # else mistakes of a user are tracebacks

import pytest  # noqa: E402
from chromium import Chromium  # noqa: E402
from hypothesis import settings  # noqa: E402

SHARED = {  # module of tests whose results are kept -> beginnings of the names of files that use them
    "diagnosed": ("test_diagnose",),
    "example": ("test_notebook", "test_output_display", "test_output_report_browser", "test_schema"),
    "sources": ("test_docstrings", "test_size"),
}

settings.register_profile("signid", derandomize=True, deadline=None, max_examples=30, database=None)
settings.load_profile("signid")


def pytest_itemcollected(item: pytest.Item) -> None:
    """Mark those cases of a parametrised test as slow whose ids match `slow_cases`, or do not match its `but`."""
    case = getattr(item, "callspec", None)
    for mark in item.iter_markers("slow_cases") if case is not None else ():
        if any(re.search(pattern, case.id) for pattern in mark.args) or (
            "but" in mark.kwargs and not re.search(mark.kwargs["but"], case.id)
        ):
            item.add_marker("slow")


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Let one worker run a file, or files that share results: these are then made once."""
    from xdist.scheduler import LoadScopeScheduling

    class ByResults(LoadScopeScheduling):
        def _split_scope(self, nodeid: str) -> str:
            file = Path(nodeid.partition("::")[0]).stem
            return next((module for module, starts in SHARED.items() if file.startswith(starts)), file)

    return ByResults(config, log)


@pytest.fixture(scope="session")
def data() -> Path:
    """The folder of real recordings."""
    folder = os.environ.get("SIGNID_DATA")
    if not folder:
        pytest.skip("SIGNID_DATA is unset: real recordings are not part of the repository")
    return Path(folder)


@pytest.fixture(scope="module")
def browser(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chromium]:
    """A window for the pages of one file, as large as the file's `WINDOW` says."""
    window = Chromium(tmp_path_factory.mktemp("browser"), *getattr(request.module, "WINDOW", ()))
    yield window
    window.close()


@pytest.fixture
def inside(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Commands run in the folder that a file of tests calls its place."""
    monkeypatch.chdir(place)
