"""UR10e of Mamedov et al.: log of its controller, text with 31 numbers per sample."""

from __future__ import annotations

from .base import UNSTATED, DataSet, Product
from .convert import by_joint, read_numbers, without_meshes, write_table

KINDS = ("q", "dq", "current", "current_des", "tau_des")
SHA256 = {
    "identification_data/20_01_31-unload": "3bbdf2e4ed1ede1390225396206855e15f259e8bd3769832ade130d6709b33bf",
    "identification_data/20_02_10-30sec_12harm": "17a262d5c1dcc008b8e5aef98b4b63b8c0ca17732a61c4e6e587c33d1934567e",
    "identification_data/20_02_12-40sec_12harm": "f21352bfd84b14f011f233632a5b1fae90e3876a3cf6edf305909ebc9d920633",
    "identification_data/20_02_12-50sec_12harm": "0ad997d37b35e976b8f86530b31e17d02d3906f41cdd8a411829e9b55c5461ba",
    "identification_data/20_02_19_14harm50sec": "208693c5535a5ccb3e741a3f2c1119d760c1b8af068badecec3dfc466dce0e23",
    "identification_data/20_02_19_14harm50secLoad": "8713b2c951bf957dd946a3c5a61f3339b7eb8c3e7f6d11f8c3b3def70788e698",
    "jointwise_motion/20_01_22-joint_1": "060724db354870e19c8659c0df4c4607b37dc6e6d12d3a90666c98a746ba1536",
    "jointwise_motion/20_01_22-joint_2": "f87bbb46d4db1a8556305e9bb5837c9aa2b37b6857f47fb6936772c0e3802d45",
    "jointwise_motion/20_01_22-joint_3": "fd3c1fbd500fe4f1392ce22d335b282bd37e7f4232b7bb24a2e8ba3116ba47cc",
    "jointwise_motion/20_01_22-joint_4": "ec87b649f94fade085f8576edc3c5091518b1a5d72b65ae60abf485d889d0da0",
    "jointwise_motion/20_01_22-joint_5": "8a983f5cfb16b1173248f3c61db4a429f2b0e52c5ab8b76d40281799713c5646",
    "jointwise_motion/20_01_22-joint_6": "9d76d480995ab91dceec5b19e52db9f8eeb5e5ca3f209d53f87e5b5f187694e0",
    "validation_data/20_01_17-ptp_10_points": "c5eae0be26309ea5b44db8c638f23aa26283b372a1974268c9a0a8fd23d2d6a6",
}


def _recording(raw: bytes) -> str:
    values = read_numbers(raw)
    columns = {"t": values[:, 0] - values[0, 0]}
    for k, kind in enumerate(KINDS):
        columns |= by_joint(kind, values[:, 1 + 6 * k : 7 + 6 * k])
    return write_table(columns)


def _product(path: str, sha256: str) -> Product:
    group, name = path.split("/")
    there = f"dataset_ur10e/{group}/ur-{name}.csv"
    return Product(f"{group}__{name.replace('-', '_')}.csv.gz", (there,), _recording, sha256)


PLUGIN = DataSet(
    name="ur10e",
    title="UR10e, motor currents, without and with a payload, 100 Hz",
    folder="ur10e_mamedov",
    seconds=753,
    repository="shamilmamedov/dynamic_calibration",
    commit="11af40e7deb758ec080a175fed8fcdd6c99aca29",
    licence=UNSTATED,
    cite="Mamedov, Mikhel, Practical Aspects of Model-Based Collision Detection, Frontiers in Robotics and AI 7, 2020",
    megabytes=17,
    products=(
        *(_product(path, sha256) for path, sha256 in SHA256.items()),
        Product(
            "ur10e.urdf",
            ("URe/urdf/ur10e.urdf",),
            without_meshes,
            "582f3dc2e1c70338f2b384c86e548cfa37810c840ccab220cb9c723151e57506",
        ),
    ),
)
