"""The status socket against hostile clients: a thousand that come, go, send, dawdle and never read.

The daemon's side never reads, never waits and never raises; a client that behaves gets its answer
before, among and after them, and no descriptor is left behind.
"""

from __future__ import annotations

import os
import random
import select
import socket
import struct
import threading
from pathlib import Path

from fuzz_chunk import Session, Target, Unexpected

from dsz_daemon.edge.status_socket import StatusSocket, ask

_TEXT = b'{"format": 1, "filler": "' + b"x" * 20_000 + b'"}\n'
_AT_ONCE = 40


def run(session: Session, count: int) -> None:
    """Waves of some dozen clients, an honest one at the end of each."""
    path = session.folder / "status.sock"
    rng = session.random
    before = _descriptors()
    server = StatusSocket(path)
    try:
        if path.stat().st_mode & 0o777 != 0o660:
            raise Unexpected(f"mode {path.stat().st_mode:o}")
        done = 0
        while done < count:
            wave = min(_AT_ONCE, count - done)
            session.begin(inputs=wave)
            clients = [_hostile(path, rng) for _ in range(wave)]
            for _ in range(wave):
                session.outcomes["answered"] += server.answer(lambda: _TEXT)
            for client in clients:
                client.close()
            _drain(server)
            _honest(server, path)
            session.outcomes["honest"] += 1
            done += wave
    finally:
        server.close()
    if path.exists():
        raise Unexpected("the socket's file is left behind")
    if _descriptors() != before:
        raise Unexpected(f"{before} descriptors before, {_descriptors()} after")


def _hostile(path: Path, rng: random.Random) -> socket.socket:
    client = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_NONBLOCK)
    kind = rng.randrange(7)
    if kind == 0:
        client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1)
    try:
        client.connect(os.fspath(path))
        if kind == 1:
            client.send(rng.randbytes(rng.randrange(1, 60_000)))
        elif kind == 2:
            client.shutdown(socket.SHUT_RD)
        elif kind == 3:
            client.shutdown(socket.SHUT_RDWR)
        elif kind == 4:
            # Gone with a reset instead of an end.
            client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            client.close()
        elif kind == 5:
            # Descriptors in the mail: whoever does not read does not get them.
            socket.send_fds(client, [b"x"], [0, 1, 2])
    except OSError:
        # The queue is full: turned away is a fair answer.
        client.close()
    return client


def _drain(server: StatusSocket) -> None:
    while select.select([server], [], [], 0.0)[0]:
        server.answer(lambda: _TEXT, at_most=100)


def _honest(server: StatusSocket, path: Path) -> None:
    found: list[object] = []

    def asks() -> None:
        try:
            found.append(ask(path, timeout_s=20.0))
        except Exception as error:  # told by the other thread
            found.append(error)

    client = threading.Thread(target=asks)
    client.start()
    while client.is_alive():
        select.select([server], [], [], 0.01)
        server.answer(lambda: _TEXT)
    client.join()
    if not isinstance(found[0], dict):
        raise Unexpected(f"an honest client got {found[0]!r}")


def _descriptors() -> int:
    return sum(1 for _ in Path("/proc/self/fd").iterdir())


TARGET = Target("status", "hostile clients of the status socket", 1_000, 1_000, 200, run)
