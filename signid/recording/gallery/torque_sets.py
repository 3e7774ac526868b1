"""Data sets with torques or motor currents: repositories, licences, files and digests."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from . import convert
from .data_set import UNSTATED, DataSet, Product

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
TORQUE_SETS = (PENDULUM, ARM, EMPS, PANDA, TX40, UR10E)
