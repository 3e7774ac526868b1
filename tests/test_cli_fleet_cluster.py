"""Fleets on a Dask cluster of several processes: killed workers lose nothing, results equal those of one machine."""

from __future__ import annotations

import os
import signal
import socket
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import dask
import distributed
import pytest
from fleets import contents, manifest, record

from signid.cli.fleet.run import Answer, Order, fleet, spread
from signid.errors import OptionError

spreading = sys.modules["signid.cli.fleet.run"]


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    once = dask.config.set({"distributed.scheduler.allowed-failures": 1})
    with once, distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0") as found:
        yield found


def workers(cluster: Any) -> tuple[list[int], list[int]]:
    """Process numbers of all workers and of busy workers."""
    with distributed.Client(cluster.scheduler_address, set_as_default=False) as client:
        pids, working = client.run(os.getpid), client.processing()
    return list(pids.values()), [pids[address] for address, tasks in working.items() if tasks and address in pids]


@pytest.mark.slow
def test_a_killed_worker_loses_nothing(cluster: Any, tmp_path: Path) -> None:
    rows = [f"3r,{day},arm {k},,identify" for k in range(2) for day in record(tmp_path, 2)]
    path, killed = manifest(tmp_path, *rows), list[int]()

    def kill(what: str, share: float) -> None:
        while not killed and what.startswith("1 of"):
            killed.extend(workers(cluster)[1][:1])
            for pid in killed:
                os.kill(pid, signal.SIGKILL)

    found = fleet(path, tmp_path / "far", scheduler=cluster.scheduler_address, progress=kill)
    assert len(killed) == 1 and all(one.done for one in found.outcomes) and len(found.outcomes) == 4
    assert killed[0] not in workers(cluster)[0]
    near = fleet(path, tmp_path / "near", workers=2)
    assert contents(tmp_path / "far") == contents(tmp_path / "near") and near.document() == found.document()


@pytest.mark.slow
def test_a_task_that_kills_workers_is_reported(cluster: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(spreading, "carry_out", _deadly)
    answers = dict(spread([Order(("die",), ""), Order(("live",), "")], scheduler=cluster.scheduler_address))
    assert answers[0].code is None and "its process died" in answers[0].said[0]
    assert answers[1].code == 0
    monkeypatch.setattr(spreading, "carry_out", _broken)
    ((_, answer),) = spread([Order((), "")], scheduler=cluster.scheduler_address)
    assert "(ModuleNotFoundError: No module named 'nowhere'); it needs the same signid" in answer.said[0]


@pytest.mark.slow
def test_a_missing_scheduler_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(spreading, "PATIENCE", 2.0)
    with pytest.raises(OptionError, match="no Dask scheduler with a worker answers at tcp://127.0.0.1:9"):
        list(spread([Order((), "")], scheduler="tcp://127.0.0.1:9"))
    with pytest.raises(OptionError, match="no Dask scheduler with a worker answers at nonsense"):
        list(spread([Order((), "")], scheduler="nonsense://x"))
    with distributed.LocalCluster(n_workers=0, dashboard_address=":0") as empty:
        with pytest.raises(OptionError, match="no Dask scheduler with a worker"):
            list(spread([Order((), "")], scheduler=empty.scheduler_address))
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(OptionError, match=r"pip install 'signid\[fleet\]'"):
        list(spread([Order((), "")], scheduler="tcp://127.0.0.1:9"))


def test_a_silent_server_is_reported_in_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(spreading, "PATIENCE", 1.0)
    with socket.create_server(("127.0.0.1", 0)) as silent:  # accepts connections and says nothing
        with pytest.raises(OptionError, match="no Dask scheduler with a worker answers at tcp://127.0.0.1"):
            list(spread([Order((), "")], scheduler=f"tcp://127.0.0.1:{silent.getsockname()[1]}"))


@pytest.mark.slow
def test_a_lost_scheduler_keeps_finished_sessions(tmp_path: Path) -> None:
    path = manifest(tmp_path, *(f"3r,{day},arm,,identify" for day in record(tmp_path)))
    cluster = distributed.LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=":0")

    def lose(what: str, share: float) -> None:
        if what.startswith("1 of"):
            cluster.close(timeout=5)

    with pytest.raises(OptionError, match="is lost; repeat the command to continue"):
        fleet(path, tmp_path / "out", scheduler=cluster.scheduler_address, progress=lose)
    assert len(list((tmp_path / "out/sessions").iterdir())) == 1


def _deadly(order: Order) -> Answer:
    if order.arguments[0] == "die":
        os.kill(os.getpid(), signal.SIGKILL)
    return Answer(0, (), {})


def _broken(order: Order) -> Answer:
    raise ModuleNotFoundError("No module named 'nowhere'")
