"""The status socket: whatever a client does, the daemon answers the others, does not wait and does not raise."""

from __future__ import annotations

import contextlib
import json
import os
import select
import socket
import stat
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from dsz_daemon.edge.status_socket import StatusSocket, ask
from dsz_daemon.errors import ConfigError, MachineError

TEXT = json.dumps({"format": 1, "words": "x" * 20_000}).encode() + b"\n"


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "status.sock"


@pytest.fixture
def door(path: Path) -> Iterator[StatusSocket]:
    with contextlib.closing(StatusSocket(path)) as opened:
        yield opened


@contextlib.contextmanager
def clients(path: Path, number: int) -> Iterator[list[socket.socket]]:
    """So many connected clients that don't wait; connecting more than the queue holds needs a served door."""
    with contextlib.ExitStack() as stack:
        found = []
        for _ in range(number):
            client = stack.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_STREAM))
            client.connect(str(path))
            client.setblocking(False)
            found.append(client)
        yield found


def everything(client: socket.socket) -> bytes:
    client.settimeout(10.0)
    parts = []
    while part := client.recv(1 << 16):
        parts.append(part)
    return b"".join(parts)


def not_asked() -> bytes:
    raise AssertionError("nobody waits: the text must not be built")


@contextlib.contextmanager
def served(door: StatusSocket, text: bytes = TEXT, at_most: int = 2) -> Iterator[None]:
    """The door answered from another thread, as a daemon's loop would."""
    stop = threading.Event()

    def serve() -> None:
        while not stop.wait(0.001):
            door.answer(lambda: text, at_most)

    thread = threading.Thread(target=serve, daemon=True)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join(10.0)
        assert not thread.is_alive()


def test_an_answer_is_the_text_and_the_end_and_nobody_else_is_asked(door: StatusSocket, path: Path) -> None:
    assert door.answer(not_asked) == 0
    with served(door):
        assert ask(path) == json.loads(TEXT)


def test_only_owner_and_group_may_connect(door: StatusSocket, path: Path) -> None:
    mode = path.stat().st_mode
    assert stat.S_ISSOCK(mode)
    assert stat.S_IMODE(mode) == 0o660


def test_epoll_tells_when_somebody_waits(door: StatusSocket, path: Path) -> None:
    with select.epoll() as epoll:
        epoll.register(door.fileno(), select.EPOLLIN)
        assert epoll.poll(0.0) == []
        with clients(path, 1) as (client,):
            assert [number for number, _ in epoll.poll(5.0)] == [door.fileno()]
            assert door.answer(lambda: TEXT) == 1
            assert epoll.poll(0.0) == []
            assert everything(client) == TEXT


def test_the_text_is_built_once_for_all_that_wait_and_only_so_many_are_answered(door: StatusSocket, path: Path) -> None:
    built = []

    def text() -> bytes:
        built.append(1)
        return TEXT

    with clients(path, 5) as waiting:
        assert [door.answer(text) for _ in range(4)] == [2, 2, 1, 0]
        assert len(built) == 3
        assert [everything(client) for client in waiting] == [TEXT] * 5


def test_a_client_that_sends_megabytes_is_not_read_and_gets_its_answer(door: StatusSocket, path: Path) -> None:
    with clients(path, 1) as (client,):
        sent = 0
        with contextlib.suppress(BlockingIOError):
            while sent < 50_000_000:
                sent += client.send(b"garbage!" * 8192)
        # The kernel's buffer is full, for nobody reads.
        assert sent < 5_000_000
        assert door.answer(lambda: TEXT) == 1
        with pytest.raises(OSError, match="pipe"):
            client.send(b"more")
        assert everything(client) == TEXT


def test_clients_that_left_early_cost_nothing(door: StatusSocket, path: Path) -> None:
    with clients(path, 3) as (closed, deaf, reset):
        closed.close()
        deaf.shutdown(socket.SHUT_RD)
        reset.send(b"unread")
        reset.close()
        assert door.answer(lambda: TEXT, at_most=3) == 0
    with served(door):
        assert ask(path) == json.loads(TEXT)


def test_what_is_not_fetched_is_bounded_and_ends_with_its_client(door: StatusSocket, path: Path) -> None:
    """The kernel keeps what a client has not fetched on the daemon's account: 16 answers at most."""
    with contextlib.ExitStack() as stack:
        deaf = []
        for _ in range(40):
            deaf += stack.enter_context(clients(path, 1))
            door.answer(lambda: TEXT)
        held = [client for client in deaf if client.recv(1, socket.MSG_PEEK)]
        assert held == deaf[:16]
        with served(door), pytest.raises(MachineError, match="did not answer within"):
            ask(path, 0.1)
        with clients(path, 1) as (turned_away,):
            assert door.answer(not_asked) == 0
            assert everything(turned_away) == b""
        # One fetches, one goes: two places.
        assert everything(deaf[0]) == TEXT
        deaf[1].close()
        with clients(path, 3) as late:
            assert door.answer(lambda: TEXT, at_most=3) == 2
            assert [bool(client.recv(1)) for client in late] == [True, True, False]


def test_five_hundred_at_once_are_all_answered_a_few_a_call(door: StatusSocket, path: Path) -> None:
    """More than may be on their way at a time: who is turned away asks again."""
    answers: list[int] = []
    calls: list[int] = []

    def ask_some() -> None:
        answers.extend(len(ask(path, 60.0)["words"]) for _ in range(20))

    threads = [threading.Thread(target=ask_some) for _ in range(25)]
    for thread in threads:
        thread.start()
    deadline_s = time.monotonic() + 60.0
    while len(answers) < 500 and time.monotonic() < deadline_s:
        calls.append(door.answer(lambda: TEXT))
    for thread in threads:
        thread.join(10.0)
    assert answers == [20_000] * 500
    assert sum(calls) == 500
    assert max(calls) <= 2


def test_the_queue_of_those_who_wait_is_bounded_too(door: StatusSocket, path: Path) -> None:
    with contextlib.ExitStack() as stack:
        connected = 0
        for _ in range(500):
            client = stack.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_NONBLOCK))
            with contextlib.suppress(BlockingIOError):
                client.connect(str(path))
                connected += 1
        assert 1 <= connected <= 20
        # To one that asks with a full queue before it, it is a daemon that does not answer, not one that is absent.
        with pytest.raises(MachineError, match=r"did not answer within 0\.05 s"):
            ask(path, 0.05)
        # Another daemon sees that this one lives.
        with pytest.raises(MachineError, match="another daemon answers there"):
            StatusSocket(path)


def test_a_text_too_large_for_the_kernel_is_cut_and_does_not_block(door: StatusSocket, path: Path) -> None:
    text = json.dumps({"words": "x" * 10_000_000}).encode()
    with clients(path, 1) as (client,):
        assert door.answer(lambda: text) == 0
        received = everything(client)
        assert received == text[: len(received)]
        assert 0 < len(received) < len(text)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (TEXT[:-1000], "cut or no JSON"),
        (b"[1, 2]\n", "no JSON object"),
        (b'{"a": NaN}\n', "NaN is no JSON number"),
        (b"\xff\xfe\x00", "cut or no JSON"),
        (b"[" * 100_000, "cut or no JSON"),
    ],
)
def test_an_answer_that_is_none_is_said_to_be(door: StatusSocket, path: Path, text: bytes, words: str) -> None:
    with served(door, text), pytest.raises(MachineError, match=words) as caught:
        ask(path)
    assert str(path) in str(caught.value)


def test_a_stranger_that_never_ends_its_answer_is_left(tmp_path: Path) -> None:
    """Not our socket: it sends without end. The asking side stops at its bound."""
    path = tmp_path / "s"
    parts: list[int] = []

    def flood(listener: socket.socket) -> None:
        client, _ = listener.accept()
        with client, contextlib.suppress(OSError):
            while sum(parts) < 50_000_000:
                parts.append(client.send(b" " * 65536))

    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(path))
        listener.listen()
        thread = threading.Thread(target=flood, args=(listener,), daemon=True)
        thread.start()
        with pytest.raises(MachineError, match="more than 1048576 bytes"):
            ask(path, 10.0)
        thread.join(10.0)
    assert sum(parts) < 5_000_000


def test_nobody_there(path: Path) -> None:
    with pytest.raises(MachineError, match=f"no daemon at {path}"):
        ask(path)
    with pytest.raises(MachineError, match="no daemon at"):
        ask(path.parent / "no" / "folder")
    # The file that a killed daemon leaves behind.
    leave_a_dead_daemons_socket(path)
    with pytest.raises(MachineError, match=f"no daemon at {path}"):
        ask(path)


def leave_a_dead_daemons_socket(path: Path) -> None:
    """A daemon that is killed leaves its file."""
    module = "dsz_daemon.edge.status_socket"
    code = f"import os, {module}; door = {module}.StatusSocket({str(path)!r}); os._exit(9)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 9
    assert path.is_socket()


def test_a_daemon_that_does_not_answer(door: StatusSocket, path: Path) -> None:
    with pytest.raises(MachineError, match=r"did not answer within 0\.05 s"):
        ask(path, 0.05)


def test_not_allowed_to_ask(door: StatusSocket, path: Path) -> None:
    if os.geteuid() != 0:
        path.chmod(0)
        with pytest.raises(MachineError, match="permission denied"):
            ask(path)
        return
    # Root may do anything: ask as nobody does.
    code = (
        "import os, sys; from dsz_daemon.edge.status_socket import ask; from dsz_daemon.errors import MachineError\n"
        "os.setgroups([]); os.setgid(65534); os.setuid(65534)\n"
        f"try: ask({str(path)!r})\nexcept MachineError as error: sys.exit(str(error))"
    )
    for folder in (path.parent, path.parent.parent, path.parent.parent.parent):
        folder.chmod(0o755)
    run = subprocess.run([sys.executable, "-c", code], check=False, capture_output=True, text=True)
    assert "permission denied; expected root or a member of the socket's group" in run.stderr


def test_a_dead_daemons_file_is_replaced(path: Path) -> None:
    leave_a_dead_daemons_socket(path)
    with contextlib.closing(StatusSocket(path)) as door, served(door):
        assert ask(path) == json.loads(TEXT)
    assert not path.exists()


def test_a_living_daemon_keeps_its_socket(door: StatusSocket, path: Path) -> None:
    with pytest.raises(MachineError, match="another daemon answers there"):
        StatusSocket(path)
    with served(door):
        assert ask(path) == json.loads(TEXT)


def test_no_other_file_is_replaced(path: Path) -> None:
    path.write_text("mine")
    with pytest.raises(MachineError, match="another file is there already"):
        StatusSocket(path)
    assert path.read_text() == "mine"


def test_closing_removes_only_its_own_file(path: Path) -> None:
    first = StatusSocket(path)
    path.unlink()
    with contextlib.closing(StatusSocket(path)):
        first.close()
        first.close()
        assert first.fileno() == -1
        assert path.is_socket()
    assert not path.exists()


def test_closing_when_the_folder_is_gone(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    folder.mkdir()
    door = StatusSocket(folder / "s")
    (folder / "s").unlink()
    folder.rmdir()
    door.close()


@pytest.mark.parametrize("use", [StatusSocket, ask])
def test_paths_that_can_be_no_sockets(use: object, tmp_path: Path) -> None:
    assert callable(use)
    long = tmp_path / ("x" * 108)
    with pytest.raises(ConfigError, match="at most 107"):
        use(long)
    with pytest.raises(ConfigError, match="expected the path of a file"):
        use("\0abstract")
    with pytest.raises(ConfigError, match="expected the path of a file"):
        use("")


def test_the_longest_path_that_fits(tmp_path: Path) -> None:
    path = tmp_path / ("x" * (107 - len(os.fsencode(tmp_path)) - 1))
    assert len(os.fsencode(path)) == 107
    with contextlib.closing(StatusSocket(path)) as door, served(door):
        assert ask(path) == json.loads(TEXT)


def test_folders_that_are_missing_or_closed_are_named(tmp_path: Path) -> None:
    with pytest.raises(MachineError, match=f"there is no folder {tmp_path / 'no'}"):
        StatusSocket(tmp_path / "no" / "s")
    (tmp_path / "file").touch()
    with pytest.raises(MachineError, match="there is no folder"):
        StatusSocket(tmp_path / "file" / "s")
    # procfs takes no sockets, whoever asks.
    with pytest.raises(MachineError, match=r"can't listen there|there is no folder"):
        StatusSocket("/proc/self/s")
