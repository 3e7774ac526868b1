"""Sessions made and diagnosed, several at once; what is found is kept, so that it can be judged again."""

from __future__ import annotations

import json
import time
import traceback
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from functools import partial
from pathlib import Path
from typing import Any

from rich.progress import Progress

from .cases import Case
from .session import make


def diagnose_session(folder: Path, skip: Sequence[str] = ()) -> dict[str, Any]:
    """What signid says of the recordings in a folder; nothing else is looked at.

    Args:
        folder: robot.urdf, actuators.toml beside it, and recording_1.parquet and so on.
        skip: effects that the library is without.
    """
    import signid
    from signid.output.report import diagnosis_document

    model = signid.load_model(folder / "robot.urdf")
    recordings = [signid.read_recording(path, model.robot) for path in sorted(folder.glob("recording_*.parquet"))]
    return diagnosis_document(signid.diagnose(model, recordings, skip=tuple(skip)))


def process(case: Case, cache: Path, diagnose: bool, again: bool) -> str:
    """Make a session, and diagnose it unless that was done; what went wrong, "" if nothing."""
    try:
        folder, result = make(case, cache), cache / "diagnoses" / f"{case.name}.json"
        if not diagnose or (result.is_file() and not again):
            return ""
        start, wall = time.process_time(), time.perf_counter()
        found = diagnose_session(folder, case.skip)
        took = {"cpu": time.process_time() - start, "wall": time.perf_counter() - wall}
        result.parent.mkdir(parents=True, exist_ok=True)
        result.write_text(json.dumps({"document": found, **took}), encoding="utf-8")
    except Exception as error:  # one case must not end the others
        return f"{case.key}: {type(error).__name__}: {error} ({traceback.extract_tb(error.__traceback__)[-1].name})"
    return ""


def process_all(
    cases: Sequence[Case], cache: Path, workers: int, progress: Progress, diagnose: bool = True, again: bool = False
) -> Iterator[str]:
    """Every case once, most at once as there are workers; what went wrong."""
    bar = progress.add_task("diagnose" if diagnose else "record", total=len(cases))
    with ProcessPoolExecutor(workers) as pool:
        job = partial(process, cache=cache, diagnose=diagnose, again=again)
        for done in as_completed([pool.submit(job, case) for case in cases]):
            progress.advance(bar)
            if wrong := done.result():
                yield wrong


def judged(cases: Sequence[Case], cache: Path) -> Iterator[tuple[dict[str, Any], dict[str, Any]]]:
    """Answer and finding of every case that was diagnosed."""
    for case in cases:
        answer, result = (cache / kind / f"{case.name}.json" for kind in ("answers", "diagnoses"))
        if answer.is_file() and result.is_file():
            yield json.loads(answer.read_text(encoding="utf-8")), json.loads(result.read_text(encoding="utf-8"))
