"""Compare outputs of commands with those of another commit, or with stored numbers; exit code 1: they differ."""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import groupby
from pathlib import Path

from benchmarks.summary import ONE_THREAD

from .compare import Difference, compare, compare_stored, principal
from .side import CASES, DONE, RECIPE

ROOT = Path(__file__).parents[2]
STORED = Path(__file__).with_name("stored.json")
SHOWN, WIDTH = 10, 200  # differences of a case, characters of a line


def main() -> int:
    """Compare, print the differences, and return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.frozen", description=__doc__)
    parser.add_argument("--against", metavar="REV", help="commit to compare with; default: stored.json")
    parser.add_argument("--only", nargs="+", metavar="CASE", choices=list(CASES), default=list(CASES))
    parser.add_argument("--cache", type=Path, metavar="DIR", help="folder that keeps the outputs of commits")
    parser.add_argument("--store", action="store_true", help="write stored.json instead of comparing with it")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        if given.against:
            differences = _against(given.against, given.only, given.cache or place, place / "current")
        else:
            _run((ROOT, place, place / "inputs", given.only))
            found = {case: principal(case, place / case) for case in given.only}
            stored = json.loads(STORED.read_text("utf-8"))
            differences = compare_stored(stored, found)
            if given.store:
                kept = (f'"{k}": {json.dumps((stored | found)[k], separators=(",", ":"))}' for k in CASES)
                STORED.write_text("{\n" + ",\n".join(kept) + "\n}\n", encoding="utf-8")
    for case, group in groupby(differences, lambda each: each.case):
        shown = list(group)
        print(f"{case}: {len(shown)} differences")
        for each in shown[:SHOWN]:
            lines = ("(nothing)" if line is None else line.strip()[:WIDTH] for line in (each.before, each.after))
            print("  {}\n    - {}\n    + {}".format(each.file, *lines))
    print(f"{len(given.only)} cases, {len(differences)} differences")
    return int(bool(differences))


def _against(revision: str, cases: Sequence[str], cache: Path, current: Path) -> list[Difference]:
    """Differences from a commit; its outputs are made unless the cache has them, beside those of this tree."""
    commit = _git("rev-parse", "--verify", f"{revision}^{{commit}}")
    inputs, reference = (cache.resolve() / commit / name for name in ("inputs", "outputs"))
    recipes = {path.parent.name: path.read_text("utf-8") for path in reference.glob(f"*/{RECIPE}")}
    missing = [case for case in cases if recipes.get(case) != CASES[case]]
    if missing or not (inputs / DONE).exists():
        with _worktree(commit) as tree:
            _run((tree, reference, inputs, ()))
            _run((tree, reference, inputs, missing), (ROOT, current, inputs, cases))
    else:
        _run((ROOT, current, inputs, cases))
    return compare(reference, current, cases)


@contextmanager
def _worktree(commit: str) -> Iterator[Path]:
    """The tree of a commit in a temporary folder, with the suite of this tree."""
    with tempfile.TemporaryDirectory() as place:
        tree = Path(place) / "tree"
        _git("worktree", "add", "--detach", "--quiet", str(tree), commit)
        try:
            suite = tree / "benchmarks/frozen"
            shutil.rmtree(suite, ignore_errors=True)
            shutil.copytree(Path(__file__).parent, suite, ignore=shutil.ignore_patterns("__pycache__"))
            yield tree
        finally:
            _git("worktree", "remove", "--force", str(tree))


def _git(*words: str) -> str:
    done = subprocess.run(["git", "-C", str(ROOT), *words], capture_output=True, text=True, encoding="utf-8")
    if done.returncode:
        sys.exit(f"git {' '.join(words)}: {done.stderr.strip()}")
    return done.stdout.strip()


def _run(*sides: tuple[Path, Path, Path, Sequence[str]]) -> None:
    """Run sides beside each other, a process each: tree, folders of outputs and inputs, cases."""
    processes = list[subprocess.Popen[bytes]]()
    for tree, out, inputs, cases in sides:
        words = [sys.executable, "-m", "benchmarks.frozen.side", out, inputs, *cases]
        processes += [subprocess.Popen(words, cwd=tree, env=os.environ | ONE_THREAD | {"PYTHONPATH": str(tree)})]
    if any([process.wait() for process in processes]):
        sys.exit("a side of the comparison failed; its error is above")


if __name__ == "__main__":
    sys.exit(main())
