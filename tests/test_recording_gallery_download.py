"""A download ends with the whole file, or with one sentence that says why not."""

from __future__ import annotations

from http.server import BaseHTTPRequestHandler

import pytest
from serving import TEXT, Server, send, serve, toy

from signid.errors import DownloadError, OptionError
from signid.recording.gallery import DATA, check_source, fetch

PATH = "logs/a_toy.csv"


@pytest.fixture(autouse=True)
def no_proxy(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing may go through a proxy to this machine."""
    monkeypatch.setenv("http_proxy", "http://127.0.0.1:9")
    monkeypatch.delenv("no_proxy", raising=False)


@pytest.fixture
def haste(monkeypatch: pytest.MonkeyPatch) -> None:
    """A limit that a test reaches."""
    monkeypatch.setattr("signid.recording.gallery.SILENCE", 0.3)


def refusal(server: Server) -> str:
    with pytest.raises(DownloadError) as caught:
        fetch(toy(), server.address)
    sentence = str(caught.value)
    assert server.address in sentence and sentence.count("--source") == 1 and "\n" not in sentence
    return sentence


def test_a_file_arrives_whole_and_progress_is_reported() -> None:
    progress: list[tuple[str, float]] = []
    with serve({PATH: TEXT}) as server:
        files = fetch(toy(), server.address + "/", progress=lambda what, share: progress.append((what, share)))
    assert set(files) == {"toy.csv.gz", "source_toy.txt"} and progress == [("downloading toy", 0.0)]
    assert server.asked == [PATH] and b"MIT" in files["source_toy.txt"] and b"0" * 40 in files["source_toy.txt"]


def test_a_file_that_is_not_there() -> None:
    with serve({}) as server:
        sentence = refusal(server)
    assert "the server answers 404 (Not Found)" in sentence and "try again" not in sentence


def test_a_transfer_that_breaks_off() -> None:
    with serve({PATH: lambda to: send(to, TEXT, length=1000)}) as server:
        assert "it ended too early; try again" in refusal(server)


def test_a_transfer_in_pieces_that_breaks_off() -> None:
    def answer(to: BaseHTTPRequestHandler) -> None:
        to.protocol_version = "HTTP/1.1"
        to.send_response(200)
        to.send_header("Transfer-Encoding", "chunked")
        to.end_headers()
        to.wfile.write(b"64\r\n" + TEXT)
        to.close_connection = True

    with serve({PATH: answer}) as server:
        assert "it ended" in refusal(server)


@pytest.mark.usefixtures("haste")
@pytest.mark.parametrize("begun", [False, True])
def test_a_server_that_falls_silent(begun: bool) -> None:
    def answer(to: BaseHTTPRequestHandler) -> None:
        if begun:
            send(to, b"t", length=100)
            to.wfile.flush()
        server.over.wait()

    with serve({PATH: answer}) as server:
        assert "no data for 0.3 s" in refusal(server)


@pytest.mark.parametrize(
    ("where", "why"),
    [
        ("ftp://localhost/x", "No connection adapters"),
        ("file:///etc/hostname", "No connection adapters"),
        ("http://[x/", "Invalid IPv6 URL"),
    ],
)
def test_a_way_to_another_protocol_is_not_followed(where: str, why: str) -> None:
    with serve({PATH: lambda to: send(to, b"", code=302, Location=where)}) as server:
        assert why in refusal(server)
    assert server.asked == [PATH]


def test_a_way_within_this_machine_is_followed_but_not_in_a_circle() -> None:
    with serve({PATH: lambda to: send(to, b"", code=302, Location="/there"), "there": TEXT}) as server:
        assert "toy.csv.gz" in fetch(toy(), server.address)
    with serve({"*": lambda to: send(to, b"", code=302, Location=f"/{PATH}")}) as server:
        assert "the server answers 302" in refusal(server)


def test_no_server_at_all_and_one_without_encryption() -> None:
    with serve({PATH: TEXT}) as server:
        with pytest.raises(DownloadError, match="cannot download https://127.0.0.1.*; try again"):
            fetch(toy(), server.address.replace("http", "https"))
        assert not server.asked
    assert "refused" in refusal(server)


@pytest.mark.parametrize(
    "address",
    ["https://raw.githubusercontent.com/x", "http://localhost:8000/x", "http://127.0.0.1/x", "http://[::1]:80/x"],
)
def test_addresses(address: str) -> None:
    assert check_source(f"{address}/") == address


@pytest.mark.parametrize(
    "source",
    [
        *("", "panda", "ftp://x/y", "http://example.com", "https://x/y?z", "https://x/y#z"),
        *("http://raw.githubusercontent.com/x", "http://127.0.0.1.example.com/x", "http://localhost@example.com/x"),
        *("https:///x", "file:///etc/hostname", "https://[::1", "https://host:port/x"),
    ],
)
def test_sources_that_are_none(source: str) -> None:
    with pytest.raises(OptionError, match="not a valid address for downloads"):
        check_source(source)


@pytest.mark.parametrize("name", DATA.names)
@pytest.mark.parametrize(
    "rubbish", [b"", b"rubbish", b"\x80\x02c", b"1,2\n3\n", b"version https://git-lfs.github.com\n"]
)
def test_files_that_are_no_recording_are_refused(name: str, rubbish: bytes) -> None:
    with serve({"*": rubbish}) as server:
        with pytest.raises(DownloadError, match=f"commit {DATA[name].commit[:12]} by --source"):
            fetch(DATA[name], server.address)


def test_another_recording_is_refused() -> None:
    with serve({"*": b"0\n" * 7, "time": b"0\n"}) as server:
        with pytest.raises(DownloadError, match="exciting_traj_1.csv.gz from .* nothing was written"):
            fetch(DATA["panda"], server.address)
    with serve({PATH: TEXT.replace(b"1.5", b"1.6")}) as server:
        with pytest.raises(DownloadError, match=r"has another content \(sha256 [0-9a-f]{12}... instead of"):
            fetch(toy(), server.address)
