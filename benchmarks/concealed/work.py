"""Recording and diagnosis of sessions in parallel; results are kept for later evaluation."""

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
    """Diagnose the recordings in a folder without access to the answers.

    Args:
        folder: folder with robot.urdf, actuators.toml, recording_1.parquet and so on.
        skip: effects removed from the library.
    """
    import signid
    from signid.output.report import diagnosis_document

    model = signid.load_model(folder / "robot.urdf")
    recordings = [signid.read_recording(path, model.robot) for path in sorted(folder.glob("recording_*.parquet"))]
    return diagnosis_document(signid.diagnose(model, recordings, skip=tuple(skip)))


def process(case: Case, cache: Path, diagnose: bool, again: bool) -> str:
    """Record and diagnose a session unless done; return the error, or an empty string."""
    try:
        folder, result = make(case, cache), cache / "diagnoses" / f"{case.name}.json"
        if not diagnose or (result.is_file() and not again):
            return ""
        start, wall = time.process_time(), time.perf_counter()
        found = diagnose_session(folder, case.skip)
        times = {"cpu": time.process_time() - start, "wall": time.perf_counter() - wall}
        result.parent.mkdir(parents=True, exist_ok=True)
        result.write_text(json.dumps({"document": found, **times}), encoding="utf-8")
    except Exception as error:  # one case must not end the others
        return f"{case.key}: {type(error).__name__}: {error} ({traceback.extract_tb(error.__traceback__)[-1].name})"
    return ""


def process_all(
    cases: Sequence[Case], cache: Path, workers: int, progress: Progress, diagnose: bool = True, again: bool = False
) -> Iterator[str]:
    """Process every case in parallel; yield the errors."""
    bar = progress.add_task("diagnose" if diagnose else "record", total=len(cases))
    with ProcessPoolExecutor(workers) as pool:
        job = partial(process, cache=cache, diagnose=diagnose, again=again)
        for done in as_completed([pool.submit(job, case) for case in cases]):
            progress.advance(bar)
            if error := done.result():
                yield error


def results(cases: Sequence[Case], cache: Path) -> Iterator[tuple[dict[str, Any], dict[str, Any]]]:
    """Yield answer and diagnosis of every diagnosed case."""
    for case in cases:
        answer, result = (cache / kind / f"{case.name}.json" for kind in ("answers", "diagnoses"))
        if answer.is_file() and result.is_file():
            yield json.loads(answer.read_text(encoding="utf-8")), json.loads(result.read_text(encoding="utf-8"))
