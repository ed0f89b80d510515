"""The daemon's door for questions: a Unix socket that only answers, and the asking side of it.

The law: whoever connects gets one JSON text and the end of the stream. The daemon never reads a byte
from a client, so there is nothing to parse and nothing to wait for. Who may connect is a matter of the
file's mode (0660) and its folder. What a client has not fetched yet stays in the kernel on the
daemon's account: so many answers may be on their way, and no more.
"""

from __future__ import annotations

import errno
import fcntl
import json
import os
import socket
import stat
import termios
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NoReturn

from dsz_daemon.errors import ConfigError, MachineError

DEFAULT_PATH = Path("/run/dsz/status.sock")

# sockaddr_un holds 108 bytes, the last of them 0 (unix(7)).
_LONGEST_PATH = 107
_MODE = 0o660
_WAITING = 16
# Answers that nobody has fetched yet. A `dsz status` that is stopped holds one; sixteen are no accident.
_UNFETCHED = 16
# A whole answer has some 20 kB; whoever sends more than this is not the daemon.
_LARGEST_ANSWER = 1 << 20
_RETRY_S = 0.01


class StatusSocket:
    """Listens at `path`, which must not be that of a running daemon; a dead one's file is replaced.

    Raises ConfigError for a path that can't be a socket's, MachineError where the folder is missing
    or not writable, or another daemon answers there.
    """

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        _check_path(self.path)
        self._unfetched: list[socket.socket] = []
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_NONBLOCK)
        try:
            self._bind()
            # Nobody can connect before listen(): the mode is right from the first client on.
            self.path.chmod(_MODE)
            self._identity = _identity(self.path)
            self._listener.listen(_WAITING)
        except OSError as error:
            self._listener.close()
            _refuse(self.path, error)
        except MachineError:
            self._listener.close()
            raise

    def _bind(self) -> None:
        try:
            self._listener.bind(os.fspath(self.path))
        except OSError as error:
            if error.errno != errno.EADDRINUSE:
                raise
            _remove_stale(self.path)
            self._listener.bind(os.fspath(self.path))

    def fileno(self) -> int:
        """For epoll: readable while a client waits. -1 once closed."""
        return self._listener.fileno()

    def answer(self, text: Callable[[], bytes], at_most: int = 2) -> int:
        """Answers up to `at_most` waiting clients with the one text; returns how many it was sent to.

        `text` is called once, and only if someone waits. Never blocks, never raises for what a client
        does: one that has gone, or does not take the whole text at once, has lost it. While too many
        have not fetched theirs, others are turned away with an empty answer.
        Called once a tick, a flood of connections costs no more than that; called on every wake of
        epoll, it would cost a core.
        """
        answered, content = 0, b""
        for _ in range(at_most):
            try:
                client, _address = self._listener.accept()
            except OSError:
                # Nobody waits any more, or the machine is out of descriptors: they may ask again.
                break
            client.setblocking(False)
            self._unfetched = [waiting for waiting in self._unfetched if not _closed_if_fetched(waiting)]
            if len(self._unfetched) >= _UNFETCHED:
                client.close()
                continue
            content = content or text()
            answered += _sent(client, content)
            self._unfetched.append(client)
        return answered

    def close(self) -> None:
        """Stops listening and removes the file if it is still ours; safe to call twice."""
        if self._listener.fileno() < 0:
            return
        self._listener.close()
        for client in self._unfetched:
            client.close()
        self._unfetched = []
        try:
            if _identity(self.path) == self._identity:
                self.path.unlink()
        except OSError:
            # Gone already, or the folder is read-only by now: the next daemon replaces it.
            return


def _check_path(path: Path) -> None:
    length = len(os.fsencode(path))
    if length > _LONGEST_PATH:
        raise ConfigError(
            f"status socket {path}: the path has {length} bytes; a Unix socket's has at most {_LONGEST_PATH}"
        )
    if "\0" in str(path) or path.name == "":
        raise ConfigError(f"status socket {str(path)!r}: expected the path of a file")


def _remove_stale(path: Path) -> None:
    try:
        is_socket = stat.S_ISSOCK(path.lstat().st_mode)
    except FileNotFoundError:
        # Its daemon ended this very moment.
        return
    if not is_socket:
        raise MachineError(f"status socket {path}: another file is there already, expected none or a stale socket")
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_NONBLOCK) as probe:
        try:
            probe.connect(os.fspath(path))
        except ConnectionRefusedError:
            path.unlink(missing_ok=True)
            return
        except BlockingIOError:
            # Its queue is full: it lives.
            pass
    raise MachineError(f"status socket {path}: another daemon answers there; stop it, or choose another path")


def _refuse(path: Path, error: OSError) -> NoReturn:
    if error.errno in (errno.ENOENT, errno.ENOTDIR):
        raise MachineError(f"status socket {path}: there is no folder {path.parent}") from error
    raise MachineError(f"status socket {path}: can't listen there: {error.strerror or error}") from error


def _identity(path: Path) -> tuple[int, int]:
    found = path.lstat()
    return found.st_dev, found.st_ino


def _sent(client: socket.socket, content: bytes) -> bool:
    try:
        whole = client.send(content, socket.MSG_NOSIGNAL) == len(content)
        # Both ways: the client sees the end, and can't go on sending what nobody reads.
        client.shutdown(socket.SHUT_RDWR)
    except OSError:
        return False
    return whole


def _closed_if_fetched(client: socket.socket) -> bool:
    """Whether the client has fetched its answer or is gone; if so, our end is closed."""
    left = bytearray(4)
    try:
        fcntl.ioctl(client, termios.TIOCOUTQ, left)
    except OSError:
        # A kernel that can't tell: nothing is gained by waiting.
        left = bytearray(4)
    if any(left):
        return False
    client.close()
    return True


def ask(path: Path | str, timeout_s: float = 2.0) -> dict[str, Any]:
    """The answer of the daemon at `path`, within timeout_s.

    Raises ConfigError for a path that can't be a socket's, MachineError when no daemon is there, we
    may not ask it, or the answer does not come, is cut or is no JSON object.
    """
    path = Path(path)
    _check_path(path)
    deadline_s = time.monotonic() + timeout_s
    try:
        content = _asked(path, deadline_s)
        while not content:
            # Turned away: too many others have not fetched their answers yet.
            time.sleep(min(_RETRY_S, _left_s(deadline_s)))
            content = _asked(path, deadline_s)
    except (FileNotFoundError, NotADirectoryError, ConnectionRefusedError) as error:
        raise MachineError(f"no daemon at {path}; is `dsz run` running with this status socket?") from error
    except PermissionError as error:
        raise MachineError(f"{path}: permission denied; expected root or a member of the socket's group") from error
    except TimeoutError as error:
        raise MachineError(f"the daemon at {path} did not answer within {timeout_s:g} s") from error
    except OSError as error:
        raise MachineError(f"{path}: can't ask: {error.strerror or error}") from error
    return _parsed(content, path)


def _asked(path: Path, deadline_s: float) -> bytes:
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as client:
        _connect(client, path, deadline_s)
        return _received(client, path, deadline_s)


def _connect(client: socket.socket, path: Path, deadline_s: float) -> None:
    while True:
        client.settimeout(_left_s(deadline_s))
        try:
            client.connect(os.fspath(path))
        except BlockingIOError:
            # The daemon's queue is full: others ask as well.
            time.sleep(min(_RETRY_S, _left_s(deadline_s)))
        else:
            return


def _received(client: socket.socket, path: Path, deadline_s: float) -> bytes:
    content = bytearray()
    while len(content) <= _LARGEST_ANSWER:
        client.settimeout(_left_s(deadline_s))
        part = client.recv(1 << 16)
        if not part:
            return bytes(content)
        content += part
    raise MachineError(f"{path}: answers with more than {_LARGEST_ANSWER} bytes; that is no dsz daemon")


def _left_s(deadline_s: float) -> float:
    left_s = deadline_s - time.monotonic()
    if left_s <= 0.0:
        raise TimeoutError
    return left_s


def _parsed(content: bytes, path: Path) -> dict[str, Any]:
    try:
        answer = json.loads(content, parse_constant=_no_constant)
    except (ValueError, RecursionError) as error:
        raise MachineError(f"{path}: the answer is cut or no JSON ({len(content)} bytes): {error}") from error
    if not isinstance(answer, dict):
        raise MachineError(f"{path}: the answer is no JSON object; that is no dsz daemon")
    return answer


def _no_constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is no JSON number")
