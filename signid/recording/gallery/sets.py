"""All data sets of the gallery by name: repositories, licences, files and digests, and how they are converted."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import partial

from ...errors import OptionError
from . import convert

_PLAIN = re.compile(r"\w[\w.+-]*")  # file names without a path
UNSTATED = "none stated (all rights reserved)"


@dataclass(frozen=True)
class Product:
    """A file that is converted from source files."""

    name: str
    sources: tuple[str, ...]  # paths in the repository, in the order of the arguments of `make`
    make: Callable[..., str]
    sha256: str  # expected digest of the text before compression


@dataclass(frozen=True)
class DataSet:
    """Public recordings at one commit of a repository on GitHub."""

    name: str
    title: str
    folder: str
    seconds: float  # duration of all recordings [s]
    repository: str  # OWNER/NAME
    commit: str
    licence: str
    cite: str
    megabytes: float  # approximate download size
    products: tuple[Product, ...]
    carried: tuple[tuple[str, str], ...] = ()  # files that come with signid: name, and path below robots/
    example: str = ""  # command of an example, with {folder} and {robots}; empty: robots/NAME/identify.py
    drives: bool = False  # commands and positions of position drives, instead of torques or motor currents

    def __post_init__(self) -> None:
        files = [*(product.name for product in self.products), *(name for name, _ in self.carried)]
        paths = [self.repository, *self.sources, *(path for _, path in self.carried)]
        for name in (self.name, self.folder, *files, *(part for path in paths for part in path.split("/"))):
            if not _PLAIN.fullmatch(name):
                fault = f"has a file or folder named {name!r}; give a name without a path"
                raise OptionError(f"data set {self.name} {fault}")

    @property
    def sources(self) -> tuple[str, ...]:
        """Paths of all files to download, without repetitions."""
        return tuple(dict.fromkeys(path for product in self.products for path in product.sources))

    @property
    def base(self) -> str:
        """Base address of the source files."""
        return f"https://raw.githubusercontent.com/{self.repository}/{self.commit}"

    @property
    def home(self) -> str:
        """Web page of the repository at the commit."""
        return f"https://github.com/{self.repository}/tree/{self.commit}"


_PANDA = tuple(
    f"matlab/data/Exciting_Traj/Trajectory_1/rbt_log/exciting_traj_{part}.txt"
    for part in ("time", "positions", "velocity", "torques")
)
_TX40 = "examples/staubli_TX40"
_SHA256 = {  # of the texts before compression
    "1dof_experiment1.csv.gz": "20ddb28ed49156518a8f3dd5c84a103a7011a0fa842f8dcab7297efed78d1fc7",
    "1dof_experiment_easy1.csv.gz": "f82c8e9be39a993b1b40eae0ffdd1adadff2bbef757bce9852d59e1b1b9eec34",
    "1dof_experiment_easy2.csv.gz": "9d2a8e4189c26da8d2b42f955ebe76a68d290f036738a027a300880e0b0d282a",
    "3dof_experiment123.csv.gz": "109baaf678c88b3e012bde5b348de490df513a427fad175cf1c23a69234b2eca",
    "3dof_experiment456.csv.gz": "b9cb9cdcf3686f32d710df522725722cb4d82e298b59acc1294f81ce1111fec0",
    "3dof_validation_trajectory7.csv.gz": "d6f52687fe11d00df5840b208262d306702f5a410baf607fa35bb90d00e5d7aa",
    "3dof_validation_trajectory8.csv.gz": "a3e1a4051269193d9ce59e7ec4d87f3d3ac59313bfda89c8feafa423f77a1d59",
    "3dof_validation_trajectory9.csv.gz": "0c4f60b1d9ee45edcf40e40a4ac69bcf74914dc332dd9e3efa352d2ad09c0943",
    "emps_train.csv.gz": "2619315f3d0488106b8a80b8aaee1356823a4d73e544960ad434ab3d9c072a8e",
    "emps_pulses.csv.gz": "dd404ed0437b7ee64a6185ed24a506e7a57ae6ac67b2a24039847f032f3fecd4",
    "exciting_traj_1.csv.gz": "edea80d89d487dfd7c95a151a2b8e3745e7ad7693a1bc25d52bcefe323fa9303",
    "exciting_traj.csv.gz": "4b0ba4d6c95e04870101dc6c96a530ffbe141b2470a3a4191f9d0df5a1b5586b",
    "tx40.urdf": "bdbe0ad7dab085348f20a003af6e585172a6bbe3e1b7a4f65dd86f2a59f2f385",
    "ur10e.urdf": "582f3dc2e1c70338f2b384c86e548cfa37810c840ccab220cb9c723151e57506",
}
_UR10E = {
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


def _splines(arm: str, number: int, *parts: str) -> tuple[str, ...]:
    """Paths of the position, velocity and acceleration files of a trajectory."""
    return tuple(f"Code/data/{arm}/trajectory{number}/{part}.mat" for part in parts)


def _product(name: str, make: Callable[..., str], *sources: str) -> Product:
    return Product(name, sources, make, _SHA256[name])


def _pendulum(name: str, *parts: str) -> Product:
    stacks = [f"Code/data/1-dof/{name}/{stack}.mat" for stack in ("Y_stack", "u_stack")]
    return _product(f"1dof_{name}.csv.gz", convert.pendulum, *stacks, *_splines("1-dof", 1, *parts))


def _arm(numbers: str) -> Product:
    paths = [path for number in numbers for path in _splines("3-dof", int(number), *convert.SPLINES)]
    name = f"experiment{numbers}"
    return _product(f"3dof_{name}.csv.gz", convert.arm, f"Code/data/3-dof/{name}/u_stack.mat", *paths)


def _trajectory(number: int) -> Product:
    paths = _splines("3-dof", number, *convert.SPLINES)
    return _product(f"3dof_validation_trajectory{number}.csv.gz", convert.motion, *paths)


def _ur10e(path: str, sha256: str) -> Product:
    group, name = path.split("/")
    there = f"dataset_ur10e/{group}/ur-{name}.csv"
    return Product(f"{group}__{name.replace('-', '_')}.csv.gz", (there,), convert.ur10e, sha256)


PENDULUM = DataSet(
    name="1r",
    title="the simulated pendulum 1r, without noise, 50 Hz",
    folder="seed_penne",
    seconds=50,
    repository="MarcoPenne/Robotics_Project",
    commit="ed5bee28024af657ebe2bb061266d55150afa1cd",
    licence=UNSTATED,
    cite="its repository: dynamic identification of a 1R and a 3R robot without the signs of their torques",
    megabytes=0.1,
    products=(_pendulum("experiment1", "pos", "vel"), _pendulum("experiment_easy1"), _pendulum("experiment_easy2")),
)
ARM = replace(
    PENDULUM,
    name="3r",
    title="the simulated arm 3r, without noise, 50 Hz",
    megabytes=0.2,
    products=(_arm("123"), _arm("456"), _trajectory(7), _trajectory(8), _trajectory(9)),
    example="signid identify 3r {folder}/3dof_experiment123.csv.gz --effects none -o result",
)
EMPS = DataSet(
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
        _product("emps_train.csv.gz", convert.emps, "examples/EMPS/data/DATA_EMPS.mat"),
        _product("emps_pulses.csv.gz", convert.emps_pulses, "examples/EMPS/data/DATA_EMPS_PULSES.mat"),
    ),
    carried=(("emps.urdf", "emps/robot.urdf"),),
)
PANDA = DataSet(
    name="panda",
    title="Franka Panda, torque sensors behind the gears, 1 kHz",
    folder="panda_gaz2019",
    seconds=21,
    repository="marcocognetti/FrankaEmikaPandaDynModel",
    commit="24d85ce4e648e2e894c832bfeee9b16711eb1a1a",
    licence="GPL-3.0",
    cite="Gaz, Cognetti, Oliva, Robuffo Giordano, De Luca, IEEE Robotics and Automation Letters 4(4), 2019",
    megabytes=4.1,
    products=(_product("exciting_traj_1.csv.gz", convert.panda, *_PANDA),),
    carried=(("panda.urdf", "panda/arm.urdf"),),
)
TX40 = DataSet(
    name="tx40",
    title="Staubli TX40, motor torques, coupled wrist, 5 kHz",
    folder="staubli_tx40",
    seconds=9,
    repository="thanhndv212/figaroh-examples",
    commit="c0b5c7f0fda10078be55104f9ee76ac106b7a5ee",
    licence="Apache-2.0 (stated in its program files)",
    cite="Nguyen, Bonnet, Sabbah, Gautier, Fernbach and others, FIGAROH, IEEE-RAS Humanoids, 2023",
    megabytes=5,
    products=(
        _product(
            "exciting_traj.csv.gz", convert.tx40, f"{_TX40}/data/pos_read_data.csv", f"{_TX40}/data/curr_data.csv"
        ),
        _product("tx40.urdf", convert.without_meshes, f"{_TX40}/urdf/tx40_mdh_modified.urdf"),
    ),
)
UR10E = DataSet(
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
        *(_ur10e(path, sha256) for path, sha256 in _UR10E.items()),
        _product("ur10e.urdf", convert.without_meshes, "URe/urdf/ur10e.urdf"),
    ),
)


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
SETS = {each.name: each for each in (PENDULUM, ARM, EMPS, PANDA, TX40, UR10E, XL330, STS3250, MAUICV)}
