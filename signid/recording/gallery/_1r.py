"""Simulated pendulum 1r: three recordings without noise."""

from __future__ import annotations

from .base import UNSTATED, DataSet, Product
from .seed import CITE, COMMIT, FOLDER, REPOSITORY, pendulum, splines

SHA256 = {
    "experiment1": "20ddb28ed49156518a8f3dd5c84a103a7011a0fa842f8dcab7297efed78d1fc7",
    "experiment_easy1": "f82c8e9be39a993b1b40eae0ffdd1adadff2bbef757bce9852d59e1b1b9eec34",
    "experiment_easy2": "9d2a8e4189c26da8d2b42f955ebe76a68d290f036738a027a300880e0b0d282a",
}
TRAJECTORY = {"experiment1": splines("1-dof", 1, "pos", "vel")}


def _product(name: str, sha256: str) -> Product:
    stacks = tuple(f"Code/data/1-dof/{name}/{stack}.mat" for stack in ("Y_stack", "u_stack"))
    return Product(f"1dof_{name}.csv.gz", (*stacks, *TRAJECTORY.get(name, ())), pendulum, sha256)


PLUGIN = DataSet(
    name="1r",
    title="the simulated pendulum 1r, without noise, 50 Hz",
    folder=FOLDER,
    seconds=50,
    repository=REPOSITORY,
    commit=COMMIT,
    licence=UNSTATED,
    cite=CITE,
    megabytes=0.1,
    products=tuple(_product(name, sha256) for name, sha256 in SHA256.items()),
)
