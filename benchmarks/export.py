"""Time of generated C: inverse dynamics beside Pinocchio's compiled loop over the same states, and other functions."""

from __future__ import annotations

import argparse
import ctypes
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin

from signid.model import Model, load_model
from signid.output.export import export
from signid.output.export.code.languages import identifier
from signid.regression.motion import Motion
from signid.robot import configuration

ROBOTS = ("ur5", "xarm7", "panda", "tiago_no_hand")
STATES, ROUNDS, CHECKED = 20_000, 9, 200
FUNCTIONS = {  # arguments; those of inverse dynamics write each state's torque, others overwrite one result
    "inverse_dynamics": "q + k * {n}, v + k * {n}, a + k * {n}, out + k * {n}",
    "tracking_torque": "q + k * {n}, v + k * {n}, a + k * {n}, v + k * {n}, 0.1, out",
    "mass_matrix": "q + k * {n}, out",
    "forward_dynamics": "q + k * {n}, v + k * {n}, a + k * {n}, out",
    "frame_jacobian": "q + k * {n}, out",
    "observer_step": "&observer, q + k * {n}, v + k * {n}, a + k * {n}, 1e-3",
}
LOOP = """
void many_{function}(const double *q, const double *v, const double *a, double *out, int count)
{{
    for (int k = 0; k < count; k++) {{
        {name}_{function}({arguments});
    }}
}}
"""


def compiled(model: Model, folder: Path) -> ctypes.CDLL:
    """Compile the C code of a model with a loop over states for each function."""
    made = export(model, "c", name="dynamics", functions=("forward", "jacobian", "observer"))
    name, n = identifier(model.robot.name), len(model.robot.joints)
    loops = [LOOP.format(function=key, name=name, arguments=x.format(n=n)) for key, x in FUNCTIONS.items()]
    state = f"static {name}_observer observer;\nvoid start(void)\n{{\n    {name}_observer_reset(&observer);\n}}\n"
    loop = '#include "dynamics.h"\n' + state + "".join(loops)
    for name, text in {"dynamics.c": made.text, "dynamics.h": made.beside[".h"], "loop.c": loop}.items():
        (folder / name).write_text(text, encoding="utf-8")
    build = ["cc", "-std=c99", "-O2", "-shared", "-fPIC", "dynamics.c", "loop.c", "-lm", "-o", "dynamics.so"]
    subprocess.run(build, cwd=folder, check=True)
    return ctypes.CDLL(str(folder / "dynamics.so"))


def seconds(run: Callable[[], object]) -> float:
    """Least processor time of several rounds [s]."""
    times = []
    for _ in range(ROUNDS):
        start = time.process_time()
        run()
        times.append(time.process_time() - start)
    return min(times)


def compare(name: str) -> None:
    """Print microseconds a state of both, their ratio, and the largest relative difference from the model's torques."""
    model = load_model(name)
    robot, n = model.robot, len(model.robot.joints)
    q, v, a = np.random.default_rng(0).normal(size=(3, STATES, n))
    tau, other = np.zeros((STATES, n)), np.zeros(6 * n * n)
    with tempfile.TemporaryDirectory() as folder:
        library = compiled(model, Path(folder))
        library.start()
        given = [x.ctypes.data_as(ctypes.c_void_p) for x in (q, v, a)]
        results = [(tau if key == "inverse_dynamics" else other).ctypes.data_as(ctypes.c_void_p) for key in FUNCTIONS]
        own, *times = (
            seconds(lambda many=library[f"many_{key}"], out=out: many(*given, out, STATES))  # type: ignore[misc]
            for key, out in zip(FUNCTIONS, results, strict=True)
        )
    whole = model.bodies()
    pool = pin.ModelPool(whole, 1)
    turned = [np.asfortranarray(x) for x in (configuration(robot, q).T, (v @ robot.drive.T).T, (a @ robot.drive.T).T)]
    out = np.zeros((whole.nv, STATES), order="F")
    theirs = seconds(lambda: pin.rneaInParallel(1, pool, *turned, out))
    few = slice(CHECKED)
    expected = model.inverse(Motion(robot, np.arange(CHECKED) * 1.0, q[few], v[few], a[few]))
    off = np.abs(expected - tau[few]).max() / np.abs(expected).max()
    first, second, *others = (x / STATES * 1e6 for x in (own, theirs, *times))
    print(f"{name:14s} {n:2d} {first:8.3f} {second:8.3f} {theirs / own:6.1f} {off:9.1e}", end="")
    print("".join(f"{x:9.3f}" for x in others))


def main() -> None:
    """Print one line a robot."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.export", description=__doc__)
    parser.add_argument("--robots", nargs="+", default=ROBOTS)
    robots = parser.parse_args().robots
    print("robot          n   C [us]  pinocchio [us] ratio  difference; then C of", *list(FUNCTIONS)[1:], "[us]")
    for robot in robots:
        compare(robot)


if __name__ == "__main__":
    main()
