"""Public recordings of real robots: find data sets, or download, convert and verify them.

Nothing is downloaded automatically: `fetch` asks pooch, over HTTPS or from this machine. `DATA` lists the data sets;
other packages register theirs at the entry point `signid.data`.
"""

from __future__ import annotations

import gzip
import io
import json
import os
import re
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from hashlib import sha256
from http.client import IncompleteRead, responses
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit
from zlib import error as ZlibError

import numpy as np

from ..errors import DownloadError, OptionError, RecordingError
from ..registry import Registry
from ..robot.locate import robots_folder
from ..types import Array
from ..version import __version__

if TYPE_CHECKING:
    from ..types import Progress

VARIABLE = "SIGNID_DATA"  # folder of downloaded recordings; by default data
LOCAL = ("localhost", "127.0.0.1", "::1")
GONE = (404, 410)  # HTTP status codes of missing files
SILENCE = 30.0  # limit of the time without data [s]
DIGITS, DRIVE_DIGITS = 9, 8  # significant digits of numbers; those of position drives
SPLINES = {"pos": "position", "vel": "velocity", "acc": "acceleration"}  # variables of the files of 1r and 3r
_RATIO = np.array([32.0, 32.0, 45.0, -48.0, 45.0, 32.0])  # gear ratios of the TX40; motor 6 also turns with joint 5
_OFFSET = np.array([0, -np.pi / 2, np.pi / 2, 0, 0, 0])  # [rad] of the TX40
_BAM = {  # column: key of an entry; angles in rad, volts, degrees Celsius, torque enabled
    "t": "timestamp",
    "q_servo": "position",
    "q_des_servo": "goal_position",
    "dq_servo": "speed",
    "pwm_servo": "load",
    "volt_servo": "input_volts",
    "temp_servo": "temp",
    "on_servo": "torque_enable",
}
_DUTY = 885  # full duty in the register of a Dynamixel XL330


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

    @property
    def sources(self) -> tuple[str, ...]:
        """Paths of all files to download, without repetitions."""
        return tuple(dict.fromkeys(path for product in self.products for path in product.sources))

    @property
    def base(self) -> str:
        """Base address of the source files."""
        return f"https://raw.githubusercontent.com/{self.repository}/{self.commit}"


def _read_numbers(raw: bytes, skip: int = 0) -> Array:
    """Numbers (rows, columns) of comma-separated text below `skip` lines of header [units of the source].

    Raises:
        ValueError: the text is not a table of numbers.
    """
    lines = raw.split(b"\n", skip)[skip:]
    if not lines or not lines[0].strip():
        raise ValueError("it contains no numbers")
    return np.loadtxt(io.BytesIO(lines[0]), delimiter=",", ndmin=2)


def _read_matrix(raw: bytes, name: str) -> Array:
    """Variable of a MATLAB file, (rows, columns) [unit of the source]."""
    from scipy.io import loadmat

    return np.asarray(loadmat(io.BytesIO(raw), variable_names=[name])[name], np.float64)


def _by_joint(kind: str, values: Array) -> dict[str, Array]:
    """Split a matrix into the columns KIND_1, KIND_2, ...; values: (N, n) [unit of the kind]."""
    return {f"{kind}_{j + 1}": column for j, column in enumerate(values.T)}


def _write_table(columns: Mapping[str, Array], digits: int = DIGITS) -> str:
    """CSV text with a header and one line per sample; columns: (N,) each, by name [units of the columns]."""
    text = io.StringIO()
    text.write(",".join(columns) + "\n")
    np.savetxt(text, np.column_stack(list(columns.values())), fmt=f"%.{digits}g", delimiter=",")
    return text.getvalue()


def _instants(samples: int, step: float = 0.02) -> Array:
    """Times of the samples, (N,) [s]; the simulated arms 1r and 3r have 50 Hz."""
    return np.arange(samples, dtype=np.float64) * step


def without_meshes(raw: bytes) -> str:
    """URDF text without visual and collision elements, whose meshes are not downloaded."""
    text = raw.decode("utf-8-sig").replace("\r\n", "\n")
    return re.sub(r"<(visual|collision)\b.*?</\1>", "", text, flags=re.DOTALL)


def pendulum(regressor: bytes, torque: bytes, position: bytes = b"", velocity: bytes = b"") -> str:
    """Recording of 1r; without a trajectory file, sin q and acceleration come from the regressor."""
    rows = _read_matrix(regressor, "Y_stack")
    columns = {"t": _instants(len(rows)), "sin_q_1": rows[:, 0], "ddq_1": rows[:, 1]}
    columns["tau_1"] = _read_matrix(torque, "u_stack")[:, 0]
    for kind, raw, part in (("q_1", position, "pos"), ("dq_1", velocity, "vel")):
        columns |= {kind: _read_matrix(raw, SPLINES[part])[0]} if raw else {}
    return _write_table(columns)


def arm(torque: bytes, *raw: bytes) -> str:
    """Recording of 3r: torque, position, velocity and acceleration of each joint."""
    tau = _read_matrix(torque, "u_stack").reshape(-1, 3)
    columns = {"t": _instants(len(tau))}
    for k, (kind, name) in enumerate(zip(("q", "dq", "ddq"), SPLINES.values(), strict=True)):
        columns |= _by_joint(kind, np.column_stack([_read_matrix(part, name)[0] for part in raw[k::3]]))
    return _write_table({**columns, **_by_joint("tau", tau)})


def motion(*raw: bytes) -> str:
    """Trajectory of one joint, without torque."""
    values = [_read_matrix(part, name)[0] for part, name in zip(raw, SPLINES.values(), strict=True)]
    return _write_table({"t": _instants(len(values[0])), **dict(zip(("q", "dq", "ddq"), values, strict=True))})


def emps(raw: bytes, pulses: Sequence[str] = ()) -> str:
    """Recording of EMPS with force = input voltage of the drive times its gain; `pulses` are variables of force."""
    t, q, voltage, reference, gain, *more = (
        _read_matrix(raw, name)[:, 0] for name in ("t", "qm", "vir", "qg", "gtau", *pulses)
    )
    columns = {"t": t - t[0], "q_1": q, "tau_1": gain * voltage, "voltage_1": voltage, "q_ref_1": reference}
    return _write_table({**columns, **dict(zip(pulses, more, strict=True))})


def log(*raw: bytes, kinds: str) -> str:
    """Recording from times and `kinds` of numbers per joint, in one file or side by side in several."""
    parts = [_read_numbers(part) for part in raw]
    rows = np.hstack([parts[0], *(part.reshape(len(parts[0]), -1) for part in parts[1:])])
    columns = {"t": rows[:, 0] - rows[0, 0]}
    for kind, values in zip(kinds.split(), np.hsplit(rows[:, 1:], len(kinds.split())), strict=True):
        columns |= _by_joint(kind, values)
    return _write_table(columns)


def tx40(positions: bytes, torques: bytes) -> str:
    """Recording of the TX40 at its joints; without a matrix product, so digits do not depend on the BLAS library."""
    motor, current = _read_numbers(positions, skip=1), _read_numbers(torques, skip=1)
    q, tau = motor * (1 / _RATIO), current * _RATIO
    q[:, 5] -= motor[:, 4] * (1 / _RATIO[4])
    tau[:, 4] += current[:, 5] * _RATIO[5]
    columns = {"t": _instants(len(q), 2e-4), **_by_joint("q", q + _OFFSET), **_by_joint("tau", tau)}
    return _write_table({**columns, **_by_joint("q_motor", motor), **_by_joint("current", current)}, digits=7)


def bam(raw: bytes) -> str:
    """Recording of a pendulum of BAM; the unsigned 16-bit register of the duty gets its sign."""
    entries = json.loads(raw)["entries"]
    columns = {name: np.array([entry[key] for entry in entries], np.float64) for name, key in _BAM.items()}
    load = columns["pwm_servo"]
    columns["pwm_servo"] = np.where(load >= 2**15, load - 2**16, load) / _DUTY
    return _write_table(columns, DRIVE_DIGITS)


MAKERS: dict[str, Callable[..., str]] = {
    make.__name__: make for make in (pendulum, arm, motion, emps, log, tx40, bam, without_meshes)
}


def _data_set(name: str, entry: dict[str, Any]) -> DataSet:
    carried, products = tuple(entry.pop("carried", {}).items()), []
    for file in entry.pop("files"):
        make = partial(MAKERS[file["make"]], **file.get("options", {}))
        products.append(Product(file["name"], tuple(file["sources"]), make, file["sha256"]))
    return DataSet(name, products=tuple(products), carried=carried, **entry)


_LISTED = tomllib.loads(Path(__file__).with_name("gallery.toml").read_text(encoding="utf-8"))
SETS = {name: _data_set(name, entry) for name, entry in _LISTED.items()}


class _Gallery(Registry[DataSet]):
    """Data sets of signid, which are no modules, and of other packages."""

    def __getitem__(self, name: str) -> DataSet:
        return SETS[name] if name in SETS else super().__getitem__(name)


DATA = _Gallery("data", __name__, " ".join(SETS))


def data_folder() -> Path:
    """Folder of the data sets: SIGNID_DATA, or `data` in the working directory."""
    return Path(os.path.expanduser(os.environ.get(VARIABLE) or "data"))


def recordings(name: str) -> Path:
    """Folder of the recordings of a data set.

    Raises:
        OptionError: unknown data set.
        RecordingError: missing or incomplete data set.
    """
    wanted = DATA[name]
    folder = data_folder() / wanted.folder
    lacking = [product.name for product in wanted.products if not (folder / product.name).is_file()]
    if lacking:
        where = f"{folder} lacks {lacking[0]}" if folder.is_dir() else f"there is no folder {folder}"
        setting = f"{VARIABLE} is {data_folder()}" if os.environ.get(VARIABLE) else f"{VARIABLE} is not set"
        raise RecordingError(f"the recordings of {name} are missing: {setting}, and {where}; run signid data {name}")
    return folder


def is_complete(wanted: DataSet, folder: Path) -> bool:
    """Whether a folder holds all files of a data set with the expected content."""
    try:
        for product in wanted.products:
            content = (folder / product.name).read_bytes()
            text = gzip.decompress(content) if product.name.endswith(".gz") else content
            if sha256(text).hexdigest() != product.sha256:
                return False
    except (OSError, EOFError, ZlibError):
        return False
    return True


def check_source(source: str) -> str:
    """Validate the folder or address of a copy of a repository and remove trailing slashes.

    Raises:
        OptionError: there is no such folder, and the address is neither https nor of this machine.
    """
    if source and os.path.isdir(folder := os.path.expanduser(source)):
        return folder.rstrip("/") or "/"
    try:
        parts = urlsplit(source)
        local, _ = parts.hostname in LOCAL, parts.port  # an invalid port is a ValueError
        allowed = parts.hostname and (parts.scheme == "https" or (parts.scheme == "http" and local))
    except ValueError:
        allowed = False
    if not allowed or parts.query or parts.fragment:
        advice = "give https://HOST/PATH, http://localhost:PORT for a server on this machine, or a folder"
        raise OptionError(f"--source {source!r} is not a valid address for downloads, and no folder; {advice}")
    return source.rstrip("/")


def fetch(wanted: DataSet, source: str | None = None, progress: Progress | None = None) -> dict[str, bytes]:
    """Download the files of a data set and return their contents by name, without writing them.

    `source` is the folder or address of a copy of the repository at the same commit; by default GitHub.

    Raises:
        DownloadError: a file cannot be downloaded or read, or has another content than expected.
    """
    base = wanted.base if source is None else check_source(source)
    raw: dict[str, bytes] = {}
    for path in wanted.sources:
        if progress is not None:
            progress(f"downloading {wanted.name}", len(raw) / len(wanted.sources))
        raw[path] = _obtain(f"{base}/{path}")
    made = {product.name: _make(product, raw, wanted, base) for product in wanted.products}
    carried = {name: (robots_folder() / path).read_bytes() for name, path in wanted.carried}
    lines = [
        f"{wanted.name}: {wanted.title}",
        f"repository: https://github.com/{wanted.repository}",
        f"commit: {wanted.commit}",
        f"downloaded from: {base}",
        f"licence: {wanted.licence}",
        f"please cite: {wanted.cite}",
        f"converted by signid {__version__} (sha256 of the text before compression):",
        *(f"  {product.sha256}  {product.name} <- {', '.join(product.sources)}" for product in wanted.products),
        *(f"  {name}: comes with signid" for name in carried),
    ]
    return {**made, **carried, f"source_{wanted.name}.txt": "\n".join([*lines, ""]).encode()}


def _make(product: Product, raw: Mapping[str, bytes], wanted: DataSet, base: str) -> bytes:
    advice = f"try again, or name a copy of the repository at commit {wanted.commit[:12]} by --source URL"
    after = f"nothing was written; {advice}"
    try:
        text = product.make(*(raw[path] for path in product.sources)).encode()
    except Exception as error:  # readers of unexpected files raise many types
        raise DownloadError(f"{product.name} from {base} cannot be read ({error}); {after}") from error
    digest = sha256(text).hexdigest()
    if digest != product.sha256:
        fact = f"has another content (sha256 {digest[:12]}... instead of {product.sha256[:12]}...)"
        raise DownloadError(f"{product.name} from {base} {fact}; {after}")
    return gzip.compress(text, mtime=0) if product.name.endswith(".gz") else text


def _obtain(address: str) -> bytes:
    """Read a file of a folder, or download it."""
    from pooch import HTTPDownloader, get_logger, retrieve

    get_logger().setLevel("WARNING")
    settings: dict[str, Any] = {"timeout": SILENCE, "headers": {"User-Agent": f"signid/{__version__}"}}
    try:
        parts = urlsplit(address)
        if not parts.scheme:
            return Path(address).read_bytes()
        settings["proxies"] = {"http": "", "https": ""} if parts.hostname in LOCAL else None
        with TemporaryDirectory() as place:
            return Path(retrieve(address, None, "source", place, downloader=HTTPDownloader(**settings))).read_bytes()
    except (OSError, ValueError) as error:  # ValueError: another attempt would fail as well
        status = getattr(getattr(error, "response", None), "status_code", None)
        reason = f"the server answers {status} ({responses.get(status, 'unknown')})" if status else _reason(error)
        again = "" if isinstance(error, ValueError) or status in GONE else "try again, or "
        advice = f"{again}name a copy of the repository by --source URL"
        raise DownloadError(f"cannot download {address}: {reason}; {advice}") from error


def _reason(error: BaseException) -> str:
    """Cause of an error of a connection, which is the first in a chain of errors."""
    while error.__context__ is not None:
        error = error.__context__
    if isinstance(error, TimeoutError):
        return f"no data for {SILENCE:g} s"
    if isinstance(error, IncompleteRead):
        return "it ended too early"
    return str(getattr(error, "strerror", None) or error).strip() or type(error).__name__
