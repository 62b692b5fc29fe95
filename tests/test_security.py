"""What comes from elsewhere is data and never program, and what goes elsewhere tells of nobody."""

import asyncio
import base64
import csv
import os
import pickle
import queue
import re
import socket
import sys
import threading
import time
import zipfile
from contextlib import contextmanager
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import jax
import numpy as np
import pytest
from drivable import model_of
from stand_ins import client_in_this_process

import preisach_jax as pj
from preisach_jax.cli import fleet, main
from preisach_jax.files import is_ours
from preisach_jax.report.content import shareable

ROOT = Path(__file__).parents[1]

SECRETS = ("secret-home", "secret-user", "secret-host")
# Linux lets a name hold bytes that are no text.
HOSTILE_FILE = "=<img src=x onerror=alert(1)>" + "\udcff" * (sys.platform == "linux") + ".csv"
HOSTILE_COLUMNS = ("t [s]", "u<script>alert(2)</script> [<b>V]", "z\"'><svg onload=alert(3)> [um]")


def write_record(path, gain=1.0, samples=700):
    """A record whose header holds markup."""
    path.parent.mkdir(parents=True, exist_ok=True)
    t = np.arange(samples) / 100
    u = 5 - 5 * np.cos(2 * t * (1 + t / 10))
    z = gain * u**1.1
    rows = [f"{a:.2f};{b:.6f};{c:.6f}" for a, b, c in zip(t, u, z, strict=True)]
    path.write_text("\n".join([";".join(HOSTILE_COLUMNS), *rows]) + "\n", encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def outputs(tmp_path_factory):
    """Everything that the commands and the methods write, made by somebody with secrets."""
    root = tmp_path_factory.mktemp("someone")
    home, out = root / SECRETS[0] / "ada", tmp_path_factory.mktemp("given_away")
    data = write_record(home / HOSTILE_FILE)
    others = [write_record(home / "stages" / f"{k}.csv", gain=2.0 + k) for k in range(2)]
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HOME", str(home))
        patch.setenv("USER", SECRETS[1])
        patch.setenv("LOGNAME", SECRETS[1])
        patch.setenv("HOSTNAME", SECRETS[2])
        patch.setattr("socket.gethostname", lambda: SECRETS[2])
        patch.setattr("platform.node", lambda: SECRETS[2])
        report = out / "report"
        columns = [word for name in zip(("--time", "--input", "--output"), HOSTILE_COLUMNS,
                                        strict=True) for word in name]  # fmt: skip
        fixed = ["--effects", "drift", "--levels", "5"]
        run("diagnose", data, *columns, *fixed, "--report", report)
        run("compare", report / "model.json", data, "--report", out / "comparison")
        run("predict", report / "model.json", data, "--out", out / "prediction.csv")
        patch.setattr(fleet, "_client", client_in_this_process)
        run("fleet", data, *others, *columns, "--fit", "--levels", "5", "--out", out / "fleet")
        nothing = {name: np.zeros(1) for name in (*pj.Sweep.AXES, "noise_um", "seeds", "key")}
        times = {"compile_s": 1.0, "run_s": 1.0, "device": jax.devices()[0].device_kind}
        sweep = pj.Sweep(**nothing, **times, levels=np.ones(1, int), weights=(np.zeros(1),),
                         samples=1000, first=0, slope=1.0)  # fmt: skip
        sweep.save(out / "sweep.npz")
        online = pj.OnlineFilter(pj.AdaptiveFilter(pj.Plane(levels=3, low=0.0, high=1.0)))
        online(0.5, 1.0)
        online.save(out / "online.npz")
    return out


def run(*words):
    assert main([str(word) for word in words]) == 0


def texts(path):
    """All bytes of a file, those that are packed in it too."""
    content = path.read_bytes()
    yield content
    if path.suffix == ".html":
        for packed in re.findall(rb"base64,([A-Za-z0-9+/=]+)", content):
            yield base64.b64decode(packed)
    if path.suffix == ".npz":
        with zipfile.ZipFile(path) as archive:
            for name in archive.namelist():
                yield archive.read(name)


def test_what_is_written_tells_nobody_who_wrote_it_and_where(outputs):
    files = [path for path in outputs.rglob("*") if path.is_file()]
    kinds = {path.suffix for path in files}
    assert {".json", ".html", ".svg", ".csv", ".npz"} <= kinds
    assert (outputs / "fleet" / "fleet.parquet") in files
    assert {path.suffix for path in files if len([*texts(path)]) > 1} == {".html", ".npz"}  # packed
    machine = [os.uname().nodename] if len(os.uname().nodename) > 4 else []
    for path in files:
        assert path.suffix == ".npz" or is_ours(path), path  # else it stays next time
        for content in texts(path):
            for secret in (*SECRETS, str(outputs.parent), *machine):
                assert secret.encode() not in content, f"{path} holds {secret}"


@pytest.mark.parametrize(
    ("command", "told"),
    [
        ("preisach diagnose /home/ada/x.csv -q", "preisach diagnose x.csv -q"),
        ("preisach fit ../../ada/x.csv --out=/home/ada/m", "preisach fit x.csv --out=m"),
        (r"preisach diagnose 'C:\Users\ada\x.csv'", "preisach diagnose x.csv"),
        ("preisach diagnose a/x.csv --unit v=um/s", "preisach diagnose a/x.csv --unit v=um/s"),
        ("preisach diagnose 'a & b.csv'", "preisach diagnose 'a & b.csv'"),
    ],
)  # fmt: skip
def test_commands_in_reports_name_files_and_not_whose_they_are(command, told):
    assert shareable(command) == told


class Tags(HTMLParser):
    """The elements of a page and their attributes."""

    def __init__(self, text):
        super().__init__()
        self.found = []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.found.append((tag, dict(attrs)))


@pytest.mark.parametrize("page", ["report/report.html", "comparison/report.html"])
def test_nothing_that_a_file_says_of_itself_becomes_markup(outputs, page):
    text = (outputs / page).read_text(encoding="utf-8")
    assert "alert(1)" in text
    assert "alert(2)" in text
    tags = Tags(text).found
    assert [tag for tag, _ in tags].count("script") == 1
    assert not {"svg", "b"} & {tag for tag, _ in tags}
    for tag, attributes in tags:
        assert not [name for name in attributes if name.startswith("on")], (tag, attributes)
        if tag == "img":
            assert attributes["src"].startswith("data:image/svg+xml;base64,")
    for packed in re.findall(r"base64,([A-Za-z0-9+/=]+)", text):
        drawn = Tags(base64.b64decode(packed).decode()).found
        assert not {"script", "img", "b", "foreignobject"} & {tag for tag, _ in drawn}
        assert not [name for _, each in drawn for name in each if name.startswith("on")]


def test_every_load_of_arrays_refuses_objects():
    package = Path(pj.__file__).parent
    sources = [path.read_text(encoding="utf-8") for path in package.rglob("*.py")]
    loads = [each for text in sources for each in re.findall(r"\b(?:np|numpy)\.load\(.*", text)]
    assert loads
    assert all("allow_pickle=False" in each for each in loads)


class Payload:
    """What makes a folder when it is unpickled."""

    def __init__(self, folder):
        self.folder = folder

    def __reduce__(self):
        return os.mkdir, (str(self.folder),)


def test_objects_packed_into_arrays_are_refused_and_not_run(tmp_path):
    ran = tmp_path / "ran"
    harmful = np.array([Payload(ran)] * 50, dtype=object)
    path = tmp_path / "harmful.npz"
    np.savez(path, t=np.arange(50.0), u=harmful, z=harmful, about=harmful)
    bare = tmp_path / "harmful.json"
    bare.write_bytes(pickle.dumps(Payload(ran)))
    for load in (
        lambda: pj.Record.load(path, time="t", input="u", output="z"),
        lambda: pj.OnlineFilter.load(path),
        lambda: pj.Sweep.load(path),
        lambda: pj.Model.load(bare),
    ):
        with pytest.raises(pj.InputError):
            load()
    assert not ran.exists()
    with np.load(path, allow_pickle=True) as archive:
        assert len(archive["u"]) == 50
    assert ran.exists()  # so it does run where it is let


@contextmanager
def serving(**options):
    """The page, served without a browser by a thread of this process."""
    pytest.importorskip("panel")
    from preisach_jax.app.server import PageServer

    made = queue.Queue()

    def serve():
        asyncio.set_event_loop(asyncio.new_event_loop())
        page = PageServer(**options)
        made.put(page)
        page.run(show=False)

    thread = threading.Thread(target=serve, daemon=True)
    thread.start()
    page = made.get(timeout=60)
    try:
        yield page
    finally:
        page.stop()
        thread.join(30)


@pytest.fixture(scope="module")
def page():
    with serving() as page:
        yield page


def test_the_page_listens_to_this_machine_alone(page):
    listening = [
        line.split()[1]
        for table in ("/proc/net/tcp", "/proc/net/tcp6")
        if Path(table).exists()
        for line in Path(table).read_text().splitlines()[1:]
        if line.split()[3] == "0A"
    ]
    if not listening:
        pytest.skip("this system does not tell who listens")
    places = [(address, int(port, 16)) for address, port in (one.split(":") for one in listening)]
    assert [address for address, port in places if port == page.port] == ["0100007F"]


def asked(port, path="/", host="127.0.0.1:{port}", begin="GET", address="127.0.0.1", **headers):
    """Status, headers and body of an answer, from a client that sends what it is told to."""
    told = {"Host": host, **{name.replace("_", "-"): value for name, value in headers.items()}}
    lines = [f"{name}: {value.format(port=port)}" for name, value in told.items() if value]
    with socket.create_connection((address, port), timeout=60) as connection:
        connection.sendall("\r\n".join([f"{begin} {path} HTTP/1.0", *lines, "", ""]).encode())
        if "Upgrade" in headers:
            answer = connection.recv(4000)
        else:
            answer = b"".join(iter(lambda: connection.recv(65536), b""))
    head, _, body = answer.decode(errors="replace").partition("\r\n\r\n")
    return int(head.split()[1]), head, body


SOCKET = {
    "Upgrade": "websocket", "Connection": "Upgrade", "Sec_WebSocket_Version": "13",
    "Sec_WebSocket_Key": "dGhlIHNhbXBsZSBub25jZQ==",
}  # fmt: skip
OURS = "http://127.0.0.1:{port}"


def cookie_of(page):
    status, head, _ = asked(page.port, page.url.partition(str(page.port))[2])
    assert (status, "Location: /\r\n" in f"{head}\r\n") == (303, True)
    [cookie] = re.findall(r"Set-Cookie: ([^;]+); HttpOnly; Path=/; SameSite=Lax", head)
    return cookie


def paths_of(page):
    """A path of each handler of the server, and of none."""
    rules = [
        inner
        for outer in page._server._tornado.default_router.rules[1:]
        for inner in outer.target.rules
    ]
    patterns = [rule.matcher.regex.pattern for rule in rules]
    assert len(patterns) > 6
    return ["/nothing", *(re.sub(r"\(.*?\)|\?|\$|\^", "", each) or "/" for each in patterns)]


def test_every_handler_refuses_another_host_and_whoever_has_no_token(page):
    own = cookie_of(page)
    paths = paths_of(page)
    assert {"/", "/ws", "/autoload.js", "/metadata", "/static/"} <= set(paths)
    for path in paths:
        for way in ({}, {**SOCKET, "Origin": OURS}):
            for host in (
                "evil.example", "evil.example:{port}", "127.0.0.1", "127.0.0.1:1", "",
                "127.0.0.1.evil.example:{port}", "192.0.2.1:{port}",
            ):  # fmt: skip
                assert asked(page.port, path, host=host, Cookie=own, **way)[0] == 403, (path, host)
            for cookie in ("", own[:-1], own + "x", own.split("=")[0] + "=ä"):
                status, _, body = asked(page.port, f"{path}?token=", Cookie=cookie, **way)
                assert status == 403, (path, cookie)
                assert way or "preisach app has printed" in body
        evil = {"host": "evil.example", "Origin": "http://evil.example"}
        assert asked(page.port, path, Cookie=own, **SOCKET, **evil)[0] == 403
        assert asked(page.port, path, begin="POST", Cookie=own, Origin="http://a.example")[0] == 403
    assert asked(page.port, "/", Cookie=own)[0] == 200
    assert asked(page.port, "/static/js/bokeh.min.js", Cookie=own)[0] == 200
    assert asked(page.port, "//evil.example/" + page.url.partition("/?")[2])[0] == 403


def test_only_the_page_itself_may_talk_to_its_server(page):
    cookie = cookie_of(page)
    text = asked(page.port, "/", Cookie=cookie)[2]
    [token] = re.findall(r'"token":\s*"([^"]+)"', text)
    secret = cookie.partition("=")[2]
    assert secret not in base64.urlsafe_b64decode(token.split(".")[0] + "===").decode()
    way = {**SOCKET, "Sec_WebSocket_Protocol": f"bokeh, {token}", "Cookie": cookie}
    for origin, answer in (
        (OURS, 101), ("http://localhost:{port}", 101), ("", 403), ("http://evil.example", 403),
        ("http://evil.example:{port}", 403), ("http://127.0.0.1.evil.example:{port}", 403),
        ("http://127.0.0.1:1", 403), ("https://127.0.0.1:{port}", 403), ("null", 403),
    ):  # fmt: skip
        assert asked(page.port, "/ws", **way, Origin=origin)[0] == answer, origin


def test_nothing_is_read_before_a_socket_is_open(tmp_path, monkeypatch):
    pytest.importorskip("panel")
    from preisach_jax.app.page import Page

    opened = []
    monkeypatch.setattr(Page, "open_file", lambda self, path: opened.append(path))
    with serving(data=tmp_path / "stage.csv") as page:
        cookie = cookie_of(page)
        text = asked(page.port, "/", Cookie=cookie)[2]
        assert "bokeh" in text
        time.sleep(0.3)
        assert not opened


@pytest.mark.parametrize(
    ("address", "listens"), [("0.0.0.0", "127.0.0.1"), ("localhost", "127.0.0.1"), ("::1", "::1")]
)
def test_other_interfaces_ask_for_the_token_as_well(address, listens):
    try:
        with socket.socket(socket.AF_INET6 if ":" in listens else socket.AF_INET) as trial:
            trial.bind((listens, 0))
    except OSError:
        pytest.skip(f"this system has no {listens}")
    with serving(address=address) as page:
        port, query = page.port, page.url.partition(str(page.port))[2]
        own = f"[{listens}]" if ":" in listens else listens
        assert asked(port, query, host=f"{own}:{port}", address=listens)[0] == 303
        assert asked(port, "/", host=f"{own}:{port}", address=listens)[0] == 403
        assert asked(port, query, host=f"evil.example:{port}", address=listens)[0] == 403
        foreign = asked(port, query, host=f"192.0.2.1:{port}", address=listens)[0]
        assert foreign == (303 if address == "0.0.0.0" else 403)


def test_where_nothing_can_listen_is_one_line(page, capsys):
    pytest.importorskip("panel")
    for words in (
        ["--port", str(page.port)], ["--port", "65536"], ["--port", "-1"],
        ["--address", "nonsense nonsense"], ["--address", "192.0.2.1"], ["--address", ""],
        ["--address", "2001:db8::1"],
    ):  # fmt: skip
        assert main(["app", "--no-browser", *words]) == 2
        said = capsys.readouterr().err
        assert said.count("\n") == 1, said
        assert words[1] in said


def pinned(name):
    text = (ROOT / name).read_text(encoding="utf-8")
    logical = re.sub(r"\\\n", " ", re.sub(r"(?m)^#.*\n", "", text)).splitlines()
    return [line for line in logical if line.strip()]


def test_every_dependency_is_pinned_with_its_hashes():
    everything, running = pinned("requirements.lock"), pinned("requirements-run.lock")
    assert len(everything) > 3 * len(running) > 100
    # What runs is what the tests ran with.
    without_markers = [
        {re.sub(r" ;.*?  ", "  ", line) for line in of} for of in (running, everything)
    ]
    assert without_markers[0] <= without_markers[1]
    for line in (*everything, *running):
        assert re.match(r"[A-Za-z0-9._-]+(\[[a-z,]+\])?==\S+ ", line), line
        assert re.search(r"--hash=sha256:[0-9a-f]{64}\b", line), line


@pytest.mark.skipif(not (ROOT / ".ci" / "run").exists(), reason="this is no checkout")
def test_what_continuous_integration_installs_is_pinned():
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    installs = [line for line in makefile.splitlines() if "$$install " in line]
    assert len(installs) == 4  # uv, what runs, this package, and what tests need
    for line in installs:
        assert "--require-hashes -r requirements" in line or "--no-deps --no-build-iso" in line
    assert "pip install" not in (ROOT / ".ci" / "run").read_text(encoding="utf-8")


@pytest.mark.skipif(os.name == "nt", reason="links and modes of POSIX")
def test_writing_keeps_the_mode_and_replaces_neither_links_nor_devices(tmp_path):
    from preisach_jax.files import write_files

    own, foreign, fifo = tmp_path / "own.csv", tmp_path / "foreign.csv", tmp_path / "fifo.csv"
    own.write_text("old")
    own.chmod(0o600)
    foreign.symlink_to(own)
    os.mkfifo(fifo)
    write_files({own: b"new"})
    assert (own.read_text(), own.stat().st_mode & 0o777) == ("new", 0o600)
    for path in (foreign, fifo):
        with pytest.raises(pj.InputError, match="link or a device"):
            write_files({path: b"other"})
    assert own.read_text() == "new"
    assert foreign.is_symlink()
    assert fifo.is_fifo()


@pytest.mark.parametrize(
    "words",
    [
        "look a", "diagnose a --report r", "predict a ok.json --out p",
        "predict m.json a --out p", "fit ok.json --out a", "diagnose ok.json --report a",
        "compare m.json ok.csv --report a", "simulate --out a", "simulate --out b --truth a",
    ],
)  # fmt: skip
def test_links_in_a_loop_are_refused_before_the_work(tmp_path, monkeypatch, capsys, words):
    monkeypatch.chdir(tmp_path)
    Path("ok.json").write_text('{"t": [0, 1, 2], "u": [0, 1, 0], "z": [0, 1, 0]}')
    Path("ok.csv").write_text("t,u,z\n0,0,0\n1,1,1\n2,0,0\n")
    model_of().save("m.json")
    Path("a").symlink_to("b")
    Path("b").symlink_to("a")
    assert main(words.split()) == 2
    said = capsys.readouterr().err
    assert re.search(r"^preisach: [ab](:| is) .*link", said), said
    assert said.count("\n") == 1


def test_a_unit_does_not_break_the_header_of_an_excitation(tmp_path):
    from preisach_jax.diagnosis.design import Design

    made = SimpleNamespace(unit="V,\n", time=np.arange(2.0), input=np.arange(2.0))
    Design.save(cast(Any, made), tmp_path / "next.csv")
    with (tmp_path / "next.csv").open(newline="") as file:
        assert list(csv.reader(file)) == [["t_s", "u_V,\ufffd"], ["0.0", "0.0"], ["1.0", "1.0"]]
