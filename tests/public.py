"""Files of public repositories, reconstructed from the recordings that were made of them: inverse of the gallery.

Text files are theirs to the last byte but for the first instant of the UR10e's logs, which no recording keeps. In
MATLAB files numbers have nine digits, chosen so that their products have the right ones, too.
"""

from __future__ import annotations

import gzip
import io
import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from scipy.io import savemat

from signid.recording.gallery import SPLINES, DataSet

GAIN = 35.1506518825  # of the EMPS [N/V], to the digits that its recordings show
START = 1000.0  # of the UR10e's clock [s]
MESH = """<{0}>
      <geometry><mesh filename="package://somewhere/{0}.stl"/></geometry>
    </{0}>"""


def layout(data: Path, wanted: DataSet) -> dict[str, bytes]:
    """Each file of the source by its path."""
    drives = {"bam_xl330": bam, "bam_sts3250": bam}
    make = {"1r": seed, "3r": seed, "emps": emps, "panda": panda, "tx40": tx40, "ur10e": ur10e, **drives}[wanted.name]
    files: dict[str, bytes] = {}
    for product in wanted.products:
        path = data / wanted.folder / product.name
        if path.suffix == ".urdf":
            files[product.sources[0]] = with_meshes(path.read_bytes())
        else:
            files |= make(product.sources, table(path))
    return files


def table(path: Path) -> dict[str, list[str]]:
    """The cells of a recording as they are written, by column."""
    header, *lines = gzip.decompress(path.read_bytes()).decode().splitlines()
    cells = zip(*(line.split(",") for line in lines), strict=True)
    return dict(zip(header.split(","), map(list, cells), strict=True))


def bam(paths: tuple[str, ...], cells: Mapping[str, list[str]]) -> dict[str, bytes]:
    keys = {"position": "q_servo", "speed": "dq_servo", "input_volts": "volt_servo", "temp": "temp_servo"}
    keys |= {"timestamp": "t", "goal_position": "q_des_servo"}
    entries = [
        {key: float(cells[name][i]) for key, name in keys.items()}
        | {"load": round(885 * float(cells["pwm_servo"][i])) % 2**16, "torque_enable": cells["on_servo"][i] == "1"}
        for i in range(len(cells["t"]))
    ]
    return {paths[0]: json.dumps({"motor": "a motor", "entries": entries}).encode()}


def panda(paths: tuple[str, ...], cells: Mapping[str, list[str]]) -> dict[str, bytes]:
    groups = [["t"], *([f"{kind}_{j}" for j in range(1, 8)] for kind in ("q", "dq", "tau"))]
    rows = [zip(*(cells[name] for name in group), strict=True) for group in groups]
    return {
        path: "".join(f"{x}\n" for row in part for x in row).encode() for path, part in zip(paths, rows, strict=True)
    }


def ur10e(paths: tuple[str, ...], cells: Mapping[str, list[str]]) -> dict[str, bytes]:
    digits = max(len(x.partition(".")[2]) for x in cells["q_1"])
    values = np.column_stack([np.array(column, float) for column in cells.values()])
    values[:, 0] += START
    text = io.StringIO()
    np.savetxt(text, values, fmt=f"%.{6 if digits > 4 else 4}f", delimiter=",")
    return {paths[0]: text.getvalue().encode()}


def tx40(paths: tuple[str, ...], cells: Mapping[str, list[str]]) -> dict[str, bytes]:
    def text(kind: str) -> bytes:
        rows = zip(*(cells[f"{kind}_{j}"] for j in range(1, 7)), strict=True)
        return "\n".join([",".join(f"{kind}{j}" for j in range(1, 7)), *map(",".join, rows), ""]).encode()

    return {paths[0]: text("q_motor"), paths[1]: text("current")}


def emps(paths: tuple[str, ...], cells: Mapping[str, list[str]]) -> dict[str, bytes]:
    values = {name: np.array(column, float)[:, None] for name, column in cells.items()}
    voltage, force = (
        [values[name] - half(values[name]), values[name] + half(values[name])] for name in ("voltage_1", "tau_1")
    )
    inside = [np.maximum(voltage[0], force[0] / GAIN), np.minimum(voltage[1], force[1] / GAIN)]
    names = {"t": "t", "q_1": "qm", "q_ref_1": "qg", "pulses_N": "pulses_N"}
    known = {there: values[here] for here, there in names.items() if here in values}
    return {paths[0]: matrix({**known, "vir": sum(inside) / 2, "gtau": GAIN})}


def seed(paths: tuple[str, ...], cells: Mapping[str, list[str]]) -> dict[str, bytes]:
    values = {name: np.array(column, float) for name, column in cells.items()}
    found, kinds = {}, {"pos": "q", "vel": "dq", "acc": "ddq"}
    for k, path in enumerate(path for path in paths if "trajectory" in path):
        kind, name = kinds[Path(path).stem], SPLINES[Path(path).stem]
        found[path] = matrix({name: values[kind if kind in values else f"{kind}_{k // 3 + 1}"][None]})
    for path in paths:
        if path.endswith("u_stack.mat"):
            torques = np.column_stack([column for name, column in values.items() if name.startswith("tau_")])
            found[path] = matrix({"u_stack": torques.reshape(-1, 1)})
        if path.endswith("Y_stack.mat"):
            found[path] = matrix({"Y_stack": np.column_stack([values["sin_q_1"], values["ddq_1"]])})
    return found


def half(values: np.ndarray) -> np.ndarray:
    """Half of the ninth digit."""
    return 0.5 * 10.0 ** (np.floor(np.log10(np.abs(np.where(values == 0, 1, values)))) - 8)


def matrix(variables: Mapping[str, object]) -> bytes:
    file = io.BytesIO()
    savemat(file, dict(variables))
    return file.getvalue()


def with_meshes(text: bytes) -> bytes:
    """Restore shapes that are blank lines in the file."""
    lines, shape = text.decode().split("\n"), 0
    for i, line in enumerate(lines):
        if line and not line.strip():
            lines[i] = line + MESH.format(("visual", "collision")[shape % 2])
            shape += 1
    return "\n".join(lines).encode()
