"""ROS 1 bags, ROS 2 bags and MCAP files: joint states, trajectories and controller states."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from ...errors import RecordingError, shorten
from ...types import Table
from .base import Format, Topic, memory_limited
from .ros import DEFINITIONS, READERS, Gather, join

PARTS = (".db3", ".mcap", ".zstd", ".yaml")  # suffixes of the files in a bag folder
SHOWN = 120  # maximum length of a quoted library message [characters]
STANDARD = ("sensor_msgs/", "trajectory_msgs/")  # message types that are equal in all releases of ROS
EXPECTED = " or ".join(", ".join(kind.rpartition("/")[2] for kind in READERS).rsplit(", ", 1))
Topics = dict[str, list[Any]]  # rosbags connections by topic


class RosBag(Format):
    """Read by the library rosbags, without an installation of ROS."""

    name, suffixes = "rosbag", (".bag", ".mcap", ".db3")
    description = "ROS 1 bag, ROS 2 bag (its folder, .db3 or .mcap): joint states, trajectories, controller states"

    def recognises(self, path: Path) -> bool:
        return (path / "metadata.yaml").is_file() if path.is_dir() else super().recognises(path)

    def files(self, path: Path) -> Sequence[Path]:
        if not path.is_dir():
            return [path]
        return sorted(part for part in path.iterdir() if part.suffix in PARTS and part.is_file())

    def open(self, path: Path) -> Table:
        return self.select(path, ())

    def select(self, path: Path, topics: Sequence[str]) -> Table:
        with _one_error(path), memory_limited(), _reader(path) as (bag, first):
            known: Topics = {}
            for connection in bag.connections:
                known.setdefault(connection.topic, []).append(connection)
            chosen = _named(path, known, topics) if topics else _chosen(path, known, bag, first)
            gathered = _gathered(bag, known, chosen, first)
            if empty := [gather.topic for gather in gathered if not gather.readings]:
                raise RecordingError(f"{path}: topic {empty[0]} holds no joints; name another topic")
            unread = [
                Topic(name, _kind(at), sum(c.msgcount for c in at), float("nan"), (), False)
                for name, at in known.items()
                if name not in chosen and _kind(at) in READERS
            ]
            return join(gathered, [*map(_topic, gathered), *unread], str(path))


@contextmanager
def _one_error(path: Path) -> Iterator[None]:
    """Convert all exceptions of the library to one RecordingError."""
    try:
        yield
    except RecordingError as error:
        if str(error).startswith(str(path)):
            raise
        raise RecordingError(f"{path}: {error}") from error
    except ImportError as error:
        advice = "reading ROS bags and MCAP needs the library rosbags; install it with: pip install 'signid[ros]'"
        raise RecordingError(f"{path}: {advice}") from error
    except MemoryError as error:
        raise RecordingError(f"{path} needs more memory than there is, or is damaged; split it by time") from error
    except Exception as error:  # broken files also raise struct, index and type errors
        quoted = " ".join(str(error).split())[:SHOWN].rstrip(".")
        reason = f" ({quoted})" if quoted else ""
        raise RecordingError(f"{path} is no ROS bag, or a damaged one{reason}; copy or record it again") from error


@contextmanager
def _reader(path: Path) -> Iterator[tuple[Any, bool]]:
    """Open bag, and whether it is a ROS 1 bag."""
    from rosbags.rosbag1 import Reader as Reader1
    from rosbags.rosbag2 import Reader as Reader2

    for part in path.iterdir() if path.is_dir() else [path]:
        if not (part.is_file() or part.is_dir()):
            raise RecordingError(f"{path}: {part.name} is not a regular file; copy the bag again")
    first = path.suffix.lower() == ".bag"
    with Reader1(path) if first else Reader2(path) as bag:
        yield bag, first


def _kind(connections: Sequence[Any]) -> str:
    """Message type of a topic, "" if it has several."""
    kinds = {connection.msgtype for connection in connections}
    return kinds.pop() if len(kinds) == 1 else ""


def _named(path: Path, known: Topics, topics: Sequence[str]) -> list[str]:
    names = []
    for asked in dict.fromkeys(topics):
        name = next((name for name in known if name.strip("/") == asked.strip("/")), None)
        if name is None:
            close = get_close_matches(asked, known, 1)
            guess = f" (perhaps {close[0]} is meant)" if close else ""
            raise RecordingError(f"{path} has no topic {asked}{guess}; it has {shorten(sorted(known)) or 'none'}")
        if _kind(known[name]) not in READERS:
            kinds = shorten(sorted({connection.msgtype for connection in known[name]}))
            raise RecordingError(f"{path}: topic {name} holds {kinds}; expected {EXPECTED}")
        names.append(name)
    return names


def _chosen(path: Path, known: Topics, bag: Any, first: bool) -> list[str]:
    """The only topic of joint states, else of controller states, else of trajectories."""
    for kind in READERS:
        names = [name for name, at in known.items() if _kind(at) == kind and sum(c.msgcount for c in at)]
        if len(names) > 1:
            listed = [_topic(gather) for gather in _gathered(bag, known, names, first)]
            facts = [f"{t.name} ({t.messages} messages, {t.rate:.4g} Hz, {shorten(t.joints, 3)})" for t in listed]
            short = kind.rpartition("/")[2]
            advice = "choose with signid convert --topic, which can be repeated"
            raise RecordingError(f"{path} has {len(names)} topics of {short}: {'; '.join(facts)}; {advice}")
        if names:
            return names
    others = shorten(sorted(f"{name} ({connections[0].msgtype})" for name, connections in known.items()), 3)
    raise RecordingError(f"{path} has no messages of {EXPECTED}; it has {others or 'no topic'}")


def _gathered(bag: Any, known: Topics, names: Sequence[str], first: bool) -> list[Gather]:
    """All messages of the named topics."""
    read = {name: Gather(name, _kind(known[name])) for name in names}
    wanted = [connection for name in names for connection in known[name]]
    decode = _decoders(wanted, first)
    for at, received, data in bag.messages(connections=wanted):
        read[at.topic].add(decode[at.msgtype](data, at.msgtype), received)
    return list(read.values())


def _decoders(connections: Sequence[Any], first: bool) -> dict[str, Any]:
    """Message decoders by type; types that differ between releases are defined by the bag."""
    from rosbags.interfaces import MessageDefinitionFormat as Form
    from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

    decoders = {}
    for kind in {connection.msgtype for connection in connections}:
        store = get_typestore(Stores.ROS1_NOETIC if first else Stores.ROS2_HUMBLE)
        if kind in DEFINITIONS:
            for name, text in DEFINITIONS.items():
                store.register(get_types_from_msg(text, name))
        elif not kind.startswith(STANDARD):
            given = next((c.msgdef for c in connections if c.msgtype == kind and c.msgdef.format != Form.NONE), None)
            if given is None:
                fault = "differs between releases of ROS and is not defined in the bag; record MCAP, which defines it"
                raise RecordingError(f"the type {kind} {fault}")
            types = get_types_from_msg(given.data, kind) if given.format == Form.MSG else get_types_from_idl(given.data)
            store.register({name: parts for name, parts in types.items() if name not in store.fielddefs})
        decoders[kind] = store.deserialize_ros1 if first else store.deserialize_cdr
    return decoders


def _topic(gather: Gather) -> Topic:
    return Topic(gather.topic, gather.kind, gather.messages, gather.rate, gather.joints, True)


PLUGIN = RosBag()
