"""File formats of recordings: text, JSON, Parquet, Arrow, NumPy, MATLAB, HDF5, ROS, LeRobot. One format per file.

A format recognises its files, opens a file as a table of named columns that is read in chunks, and optionally writes
files. `signid.recording` builds a recording from the table.

To add a format, write a module here after the example of `signid.recording.formats.npz`, derive
`signid.recording.formats.base.Format`, and add its name below; or register an entry point `signid.formats` in another
package.
"""

from pathlib import Path

from ...errors import RecordingError
from ...registry import Registry
from .base import Format

PICKLED = (".pt", ".pth", ".pkl", ".pickle", ".p", ".joblib", ".dill")  # suffixes of files of Python objects
FORMATS: Registry[Format] = Registry("formats", __name__, "csv_ lerobot parquet arrow npz npy matlab hdf5 rosbag json_")


def find_format(path: Path) -> Format:
    """First format that recognises a file: formats of signid, then those of other packages.

    Raises:
        RecordingError: unknown format.
    """
    from importlib.metadata import entry_points  # slow import

    names = (*FORMATS.names, *(point.name for point in entry_points(group="signid.formats")))
    for name in names:
        if FORMATS[name].recognises(path):
            return FORMATS[name]
    known = ", ".join(dict.fromkeys(suffix for form in FORMATS for suffix in form.suffixes))
    if path.is_dir():
        kinds = "a file of samples, a ROS 2 bag (with metadata.yaml) or a LeRobot dataset (with meta/info.json)"
        raise RecordingError(f"recording {path} is a folder; expected {kinds}")
    if path.name.lower().endswith(PICKLED):
        load = "torch.load" if path.name.lower().endswith((".pt", ".pth")) else "pickle.load"
        fact = f"recording {path} is of Python objects, which are never unpickled, since that runs code of the file"
        raise RecordingError(
            f"{fact}; in the program that trusts it, load it by {load} and save its arrays by numpy.savez"
            f'("{path.stem}.npz", t=t, q=q, tau=tau)'
        )
    raise RecordingError(f"recording {path} has no known format; expected a name that ends in {known}")
