"""One command of signid, its processor time and memory: `python -m benchmarks.watched FILE [--profile] COMMAND ...`.

It is run as `signid COMMAND ...` is, in a process that has imported nothing before. FILE gets its exit code, its time
[s], that before anything of signid was imported, and the most memory that it held [MB]; FILE.prof what cProfile saw.
"""

from __future__ import annotations

import cProfile
import json
import sys
import time
from pathlib import Path


def peak() -> float:
    """Most memory that this process ever held [MB]; where the system tells, without what its parent held."""
    status = Path("/proc/self/status")
    if status.is_file():
        line = next(x for x in status.read_text(encoding="utf-8").splitlines() if x.startswith("VmHWM"))
        return float(line.split()[1]) * 1.024e-3
    import resource

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1e-6 if sys.platform == "darwin" else 1.024e-3)


def main() -> None:
    """Run the command and write the numbers."""
    target, *command = sys.argv[1:]
    profile, started = cProfile.Profile(time.process_time), time.process_time()
    if watch := command[0] == "--profile":
        profile.enable()
    from signid.cli import run  # here, because its imports count

    code = run(command[watch:])
    profile.disable()
    numbers = {"code": code, "seconds": time.process_time(), "started": started, "memory": peak()}
    Path(target).write_text(json.dumps(numbers), encoding="utf-8")
    if watch:
        profile.dump_stats(f"{target}.prof")


if __name__ == "__main__":
    main()
