"""The benchmark of exported loops: a pendulum with known drives, by the script of its export."""

from __future__ import annotations

from pathlib import Path

from benchmarks.export_loop import CLOSE, STEPS, recorded, rolled
from benchmarks.servo.robots import benches


def test_exports_of_a_pendulum_repeat_its_recording(tmp_path: Path) -> None:
    (bench,) = benches(tmp_path, ("pendulum",))
    rows = list(rolled(recorded(bench, bench.drives, 1), tmp_path))
    assert len(rows) == 1 + 2 * len(STEPS)
    assert rows[0].whole_signid < CLOSE and rows[0].whole_recording < CLOSE
    assert all(row.rounding > 0 and row.whole_signid < row.rounding + CLOSE for row in rows[1:])
