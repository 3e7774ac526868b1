"""EMPS prismatic drive, a benchmark of nonlinear identification: MATLAB files."""

from __future__ import annotations

from .base import DataSet, Product
from .convert import read_matrix, write_table

FOLDER = "examples/EMPS/data"


def _recording(raw: bytes, pulses: tuple[str, ...] = ()) -> str:
    """Recording with force = input voltage of the drive times its gain."""
    t, q, voltage, reference, gain, *more = (
        read_matrix(raw, name)[:, 0] for name in ("t", "qm", "vir", "qg", "gtau", *pulses)
    )
    columns = {"t": t - t[0], "q_1": q, "tau_1": gain * voltage, "voltage_1": voltage, "q_ref_1": reference}
    return write_table({**columns, **dict(zip(pulses, more, strict=True))})


def _pulsed(raw: bytes) -> str:
    return _recording(raw, ("pulses_N",))


PLUGIN = DataSet(
    name="emps",
    title="EMPS prismatic drive, input voltage x gain, 1 kHz",
    folder="emps_janot",
    seconds=49.7,
    repository="forgi86/sysid-neural-continuous",
    commit="956aa7ecd73061b0321c6f6098d74c9e4a7ce67a",
    licence="none stated (licence of the repository: Apache-2.0)",
    cite="Janot, Gautier, Brunot, Data Set and Reference Models of EMPS, Nonlinear Sys. Id. Benchmarks, 2019",
    megabytes=2,
    products=(
        Product(
            "emps_train.csv.gz",
            (f"{FOLDER}/DATA_EMPS.mat",),
            _recording,
            "2619315f3d0488106b8a80b8aaee1356823a4d73e544960ad434ab3d9c072a8e",
        ),
        Product(
            "emps_pulses.csv.gz",
            (f"{FOLDER}/DATA_EMPS_PULSES.mat",),
            _pulsed,
            "dd404ed0437b7ee64a6185ed24a506e7a57ae6ac67b2a24039847f032f3fecd4",
        ),
    ),
    carried=(("emps.urdf", "emps/robot.urdf"),),
)
