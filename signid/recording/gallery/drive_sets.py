"""Data sets of position drives, commands and positions: repositories, licences, files and digests."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial

from . import convert_drives as convert
from .data_set import UNSTATED, DataSet, Product

_XL330 = {  # file: time of its log on 2026-01-15, and sha256 of the text before compression
    "kp100_sin_sin": ("10h28m10", "5e2b7dc7b974bc44954480faab95ebf45a103061fbd23cd92d7d24e0c434e5cd"),
    "kp100_lift_and_drop": ("10h28m17", "36e062434092a4fe39cc4f9e3a7361c050b0c5638f81db7ca84b75e63a048113"),
    "kp100_up_and_down": ("10h28m24", "f24f206ae4fc1175eebbb6b2164abde670eeca0367ac6cd7ecb129b340f68a05"),
    "kp100_sin_time_square": ("10h28m32", "82a3d34638390243503489c4f6bd339405f606f8235db03b44aa49e224d8f4a3"),
    "kp400_sin_sin": ("10h29m14", "cba7713e18a6ebb9b9377f46591a0ae53258918881d6eed8613b5a6d31934a30"),
    "kp400_lift_and_drop": ("10h29m21", "1bc6452c97ad709564c4798c32252087fcd627a4a87f635532a2c39af83c0dbf"),
    "kp400_up_and_down": ("10h29m29", "fa439d8bf7b55a8f6a9ba67da56fb39c72a7eefc87103b9a676b8d42d9d32b79"),
    "kp400_sin_time_square": ("10h29m37", "3710cbaed629230cd3f4e50b586cc347619d74a778d1bcf62633cb068e2ef8ad"),
}
_STS3250 = {  # as above, on 2024-10-26
    "kp32_lift_and_drop": ("12h23m42", "cb4257377e7de33f5614a002591dc9426f152c00fc8baaee4fedd12f163e2994"),
    "kp32_sin_time_square": ("12h24m55", "751f15be8070e3c1c12934607cf84617562ba818af12e975ff6ea2fcd83e0e45"),
    "kp32_up_and_down": ("12h27m27", "9433d7e60f6d818786f64f64d18c57ab9e6c53303b9f98aa694d70e4ad2abff8"),
}
_MAUICV = {  # motion, and small or large commands: sha256
    ("chirp", ""): "c20940e8c7794d03eb69cdef17560e77b5decba16b9d3ff33a4a428579e1a2c7",
    ("step", "small"): "6f16cdced56a82f0eb5dda52dbdfa789b9cdca659367b3f810b359785e25773a",
    ("step", "large"): "306d0dda0108b7eda4f5573270afe0a51acc567a793b793b9e6318ee1d6662c5",
    ("prbs", "small"): "9073b19902c422e4a8d0596080b23ddba22c076e6ae5400ae8e83c1b3a980273",
    ("prbs", "large"): "2b8c75f9775e7c1af9b620015856fa7fd3ee97e71ec0025df8e02f418d5ce8e6",
    ("ramp", ""): "2aabbdd39d493fa6ceaebd9f97823d09a3cadf9d093dd2eef02a403a61e59be7",
    ("triangle", ""): "8a15765f6cde02041a04423155f28042cb9df88db629739f6e199560220227fd",
    ("square", "small"): "5ffe2f1aa88ed6a0024e28825365cee3c94dd4dbfb37e0edf48a3e2f1762c686",
    ("square", "large"): "dfa9ccf263a0d2a4e1628e559b7e94e180fce5c828268e590bc03f71f9501152",
    ("drop", ""): "3e22729f1b122e38a24ce4f5591a4d570178002c36614f461e50ade2b5e6a3cc",
}
_MAUICV_DROPS = (
    "77d249d370ed08c5fb1ecc8cf4a3ced387f525f04bc2cc6689e6c78c016ba411",
    "5d4eeaa4e4c6ec6a3e1205e51558258d68eb713820dcacb7f02dea32500176d0",
)
_MAUICV_FOLDER = "src/sysid/dataset"
_BAM_CITE = "Duclusaud, Passault, Padois, Ly, Extended Friction Models [...] of Servo Actuators, arXiv 2410.08650, 2024"


def _bam(name: str, log: str, sha256: str) -> Product:
    return Product(f"{name}.csv.gz", (f"{log}.json",), convert.bam, sha256)


def _paths(names: Iterable[str]) -> str:
    """Recordings for the command of an example."""
    return " ".join(f"{{folder}}/{name}.csv.gz" for name in names)


def _mauicv(motion: str, size: str, sha256: str) -> Product:
    make = partial(convert.mauicv, motion=motion, small={"small": True, "large": False}.get(size))
    name = "_".join(filter(None, ("a", motion, size)))
    return Product(f"{name}.csv.gz", (f"{_MAUICV_FOLDER}/dataset.json",), make, sha256)


def _mauicv_drop(number: int, sha256: str) -> Product:
    there = f"{_MAUICV_FOLDER}/drop-response-{number}.json"
    return Product(f"a_drop_long_{number}.csv.gz", (there,), convert.mauicv_drop, sha256)


XL330 = DataSet(
    name="bam_xl330",
    title="Dynamixel XL330 pendulum, duty, voltage, 200 Hz",
    folder="bam_xl330",
    seconds=48,
    repository="Rhoban/bam",
    commit="af2260462471ff45ac18af159b1327ea51d8db15",
    licence="Apache-2.0",
    cite=_BAM_CITE,
    megabytes=2,
    products=tuple(
        _bam(name, f"bam/data.bak/raw/2026-01-15_{time}", sha256) for name, (time, sha256) in _XL330.items()
    ),
    carried=(("pendulum.urdf", "bam_xl330/robot.urdf"),),
    example=f"signid identify bam_xl330 --actuators {{robots}}/bam_xl330/actuators.toml "
    f"{_paths(name for name in _XL330 if not name.endswith('up_and_down'))} "
    "--held-out {folder}/kp100_up_and_down.csv.gz --held-out {folder}/kp400_up_and_down.csv.gz -o result",
    drives=True,
)
STS3250 = DataSet(
    name="bam_sts3250",
    title="Feetech STS3250 pendulum, voltage, 50 Hz",
    folder="bam_sts3250",
    seconds=18,
    repository="Rhoban/bam",
    commit="d13c05771e2112b34b60ddccc9f226fef2cf7477",
    licence="Apache-2.0",
    cite=_BAM_CITE,
    megabytes=0.2,
    products=tuple(
        _bam(name, f"data_raw_feetech/2024-10-26_{time}", sha256) for name, (time, sha256) in _STS3250.items()
    ),
    carried=(("pendulum.urdf", "bam_sts3250/robot.urdf"),),
    example="signid identify bam_sts3250 {folder}/kp32_lift_and_drop.csv.gz {folder}/kp32_sin_time_square.csv.gz "
    "--held-out {folder}/kp32_up_and_down.csv.gz -o result",
    drives=True,
)
MAUICV = DataSet(
    name="mauicv_servo",
    title="Miuzei hobby servo with a weight, 50 Hz",
    folder="mauicv_servo",
    seconds=188,
    repository="mauicv/servo-sysid",
    commit="e4a48407899108cae084ff25e8b5d12e3da070cc",
    licence=UNSTATED,
    cite="its repository: identification of a hobby servo for simulation in MuJoCo",
    megabytes=0.3,
    products=(
        *(_mauicv(*which, sha256) for which, sha256 in _MAUICV.items()),
        *(_mauicv_drop(number, sha256) for number, sha256 in enumerate(_MAUICV_DROPS, start=1)),
    ),
    carried=(("arm.urdf", "mauicv_servo/robot.urdf"),),
    example="signid identify mauicv_servo {folder}/a_prbs_large.csv.gz {folder}/a_triangle.csv.gz "
    "--held-out {folder}/a_chirp.csv.gz -o result",
    drives=True,
)
DRIVE_SETS = (XL330, STS3250, MAUICV)
