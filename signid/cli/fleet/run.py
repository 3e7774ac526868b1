"""Run the sessions of a manifest, store each in its folder, and evaluate them jointly."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from ...errors import InputError, ManifestError, SignidError
from ...typed import typed
from ...types import Input, Progress
from .dispatch import Answer, Order, cores, spread
from .manifest import Entry, Manifest, read_manifest
from .result import Fleet, Outcome, gather
from .store import Store, check_robot, key, read_inputs
from .summary import FILES, Summary, summarise


@dataclass(frozen=True)
class _Task:
    """A session with its input files and its key."""

    entry: Entry
    inputs: tuple[Input, ...]
    key: str  # "" if an input file cannot be read
    fault: str = ""  # reason


@typed
def fleet(
    manifest: str | Path,
    folder: str | Path,
    *,
    scheduler: str | None = None,
    workers: int | None = None,
    seed: int = 0,
    keep_going: bool = True,
    progress: Progress | None = None,
    failed: Callable[[str], None] | None = None,
) -> Fleet:
    """Diagnose or identify many robots and recordings, each session in a separate process.

    The folder of a session appears when it is complete; it holds the files of its command and session.json. Existing
    sessions with the same files, command and version are not run again.

    Args:
        manifest: CSV file of sessions, see `read_manifest`.
        folder: output folder; its folder `sessions` gets one folder per session.
        scheduler: address of a Dask scheduler to use; its workers read the same paths as this machine.
        workers: processes on this machine; default: one per core.
        seed: seed of every session.
        keep_going: continue if a session fails.
        progress: callback with the number of completed sessions.
        failed: callback with a sentence for each session that fails, at once: before any session runs if a file of it
            cannot be read.

    Raises:
        ManifestError: rows of the manifest are invalid.
        InputError: the scheduler is not available; or a session failed and `keep_going` is False.
        OutputError: results cannot be written.
    """
    listed = read_manifest(manifest)
    report = progress or (lambda stage, share: None)
    say = failed or (lambda sentence: None)
    tasks = _prepare(listed, seed, workers or cores(), report)
    with Store(folder) as store:
        store.check(task.entry.session for task in tasks)
        answers = {k: Answer(None, (task.fault,), {}) for k, task in enumerate(tasks) if task.fault}
        if answers and not keep_going:
            raise InputError(_sentence(tasks[min(answers)].entry, answers[min(answers)]))
        for k, answer in answers.items():
            say(_sentence(tasks[k].entry, answer))
        todo = [k for k, task in enumerate(tasks) if store.record(task.entry.session).get("key") != task.key != ""]
        done = len(tasks) - len(todo)
        reused = done - len(answers)
        report(f"{done} of {len(tasks)} sessions", done / len(tasks))
        entries = [tasks[k].entry for k in todo]
        orders = [Order(one.arguments(seed), str(listed.folder)) for one in entries]
        with closing(spread(orders, workers, scheduler)) as found:
            for number, answer in found:
                task, done = tasks[todo[number]], done + 1
                if answer.done:
                    _keep(store, task, orders[number], answer)
                elif keep_going:
                    answers[todo[number]] = answer
                    say(_sentence(task.entry, answer))
                else:
                    raise InputError(_sentence(task.entry, answer))
                report(f"{done} of {len(tasks)} sessions", done / len(tasks))
        return gather(
            [_outcome(store, task, answers.get(k)) for k, task in enumerate(tasks)], listed.input, seed, reused
        )


def _prepare(listed: Manifest, seed: int, workers: int, report: Progress) -> list[_Task]:
    """Check all robots, then list each session with the digests of its files."""
    described, faults = list[tuple[Input, ...]](), list[str]()
    for entry in listed.entries:
        try:
            described.append(check_robot(entry, listed.folder))
        except SignidError as error:
            faults.append(f"{Path(listed.input.path).name}, line {entry.line}: {error}")
    if faults:
        raise ManifestError(faults)

    def made(entry: Entry, robot: Sequence[Input]) -> _Task:
        try:
            inputs = (*robot, *read_inputs(entry, listed.folder))
        except InputError as error:
            return _Task(entry, (), "", str(error))
        return _Task(entry, inputs, key(entry.arguments(seed), inputs))

    tasks = list[_Task]()
    with ThreadPoolExecutor(workers) as pool:  # digests are computed in parallel
        for task in pool.map(made, listed.entries, described):
            report("reading recordings", len(tasks) / len(listed.entries))
            tasks.append(task)
    return tasks


def _keep(store: Store, task: _Task, order: Order, answer: Answer) -> None:
    record = {
        "session": task.entry.session,
        "key": task.key,
        "arguments": list(order.arguments),
        "inputs": [file._asdict() for file in task.inputs],
        "code": answer.code,
        "said": list(answer.said),
        "files": sorted(answer.files),
        "version": order.version,
    }
    store.keep(task.entry.session, record, answer.files)


def _outcome(store: Store, task: _Task, answer: Answer | None) -> Outcome:
    """The outcome of a session, from its folder or from the answer of a failed command."""
    if answer is not None:
        return Outcome(task.entry, answer.code, answer.said, (), Summary())
    record = store.record(task.entry.session)
    summary = summarise(task.entry.task, store.document(task.entry.session, FILES[task.entry.task]))
    return Outcome(task.entry, record["code"], tuple(record["said"]), tuple(record["files"]), summary)


def _sentence(entry: Entry, answer: Answer) -> str:
    return f"session {entry.session} (line {entry.line}) failed: {'; '.join(answer.said) or 'no reason given'}"
