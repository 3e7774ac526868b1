"""Simulated arm 3r: two recordings without noise, and three trajectories of single joints."""

from __future__ import annotations

from .base import UNSTATED, DataSet, Product
from .seed import CITE, COMMIT, FOLDER, REPOSITORY, SPLINES, arm, motion, splines


def _recording(numbers: str, sha256: str) -> Product:
    paths = [path for number in numbers for path in splines("3-dof", int(number), *SPLINES)]
    name = f"experiment{numbers}"
    return Product(f"3dof_{name}.csv.gz", (f"Code/data/3-dof/{name}/u_stack.mat", *paths), arm, sha256)


def _trajectory(number: int, sha256: str) -> Product:
    return Product(f"3dof_validation_trajectory{number}.csv.gz", splines("3-dof", number, *SPLINES), motion, sha256)


PLUGIN = DataSet(
    name="3r",
    title="the simulated arm 3r, without noise, 50 Hz",
    folder=FOLDER,
    seconds=50,
    repository=REPOSITORY,
    commit=COMMIT,
    licence=UNSTATED,
    cite=CITE,
    megabytes=0.2,
    products=(
        _recording("123", "109baaf678c88b3e012bde5b348de490df513a427fad175cf1c23a69234b2eca"),
        _recording("456", "b9cb9cdcf3686f32d710df522725722cb4d82e298b59acc1294f81ce1111fec0"),
        _trajectory(7, "d6f52687fe11d00df5840b208262d306702f5a410baf607fa35bb90d00e5d7aa"),
        _trajectory(8, "a3e1a4051269193d9ce59e7ec4d87f3d3ac59313bfda89c8feafa423f77a1d59"),
        _trajectory(9, "0c4f60b1d9ee45edcf40e40a4ac69bcf74914dc332dd9e3efa352d2ad09c0943"),
    ),
    example="signid identify 3r {folder}/3dof_experiment123.csv.gz --effects none -o result",
)
