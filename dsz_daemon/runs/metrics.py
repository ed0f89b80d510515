"""`dsz metrics`: the daemon's figures for Prometheus, from a process of its own. Asks the status socket per scrape.

Whatever is done to this door costs the daemon no more than an answer each `_FRESH_S`. Requests are
bounded: so many at once, each so many seconds in all, no body is read.
"""

from __future__ import annotations

import contextlib
import signal
import socket
import sys
import threading
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from ipaddress import ip_address
from pathlib import Path
from socketserver import TCPServer
from types import FrameType
from typing import Any, NoReturn

from dsz_daemon.errors import ConfigError, MachineError
from dsz_daemon.runs.asking import answer
from dsz_daemon.runs.exposition import CONTENT_TYPE
from dsz_daemon.runs.metrics_text import metrics_text

DEFAULT_LISTEN = "127.0.0.1:9273"

_FRESH_S = 0.2
_ASK_TIMEOUT_S = 2.0
# From the connection to the end of the answer; Prometheus itself gives up after 10 s.
_REQUEST_S = 5.0
_AT_ONCE = 8


class Figures:
    """The page of now, asked for at most every `_FRESH_S`; may be called from several threads."""

    def __init__(self, path: Path) -> None:
        self._path, self._lock = path, threading.Lock()
        self._page, self._asked_s = "", float("-inf")

    def page(self) -> str:
        """The text; `dsz_up 0` while the daemon does not answer."""
        with self._lock:
            if time.monotonic() - self._asked_s >= _FRESH_S:
                try:
                    self._page = metrics_text(answer(self._path, _ASK_TIMEOUT_S))
                except MachineError:
                    self._page = metrics_text(None)
                self._asked_s = time.monotonic()
            return self._page


class _Handler(BaseHTTPRequestHandler):
    server: MetricsServer
    server_version, sys_version = "dsz", ""

    def do_GET(self) -> None:
        """The page at /metrics, a pointer to it at /."""
        self._respond(with_body=True)

    def do_HEAD(self) -> None:
        """The same without the page."""
        self._respond(with_body=False)

    def _respond(self, with_body: bool) -> None:
        where = self.path.partition("?")[0]
        if where not in ("/", "/metrics"):
            self.send_error(404, "expected /metrics")
            return
        body = (self.server.figures.page() if where == "/metrics" else "dsz: see /metrics\n").encode()
        self.send_response(200)
        self.send_header("Content-Type", CONTENT_TYPE)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        if with_body:
            self.wfile.write(body)

    def log_message(self, format: str, *args: Any) -> None:  # noqa: A002 - the name that the base class gives it
        """Nothing: a line a scrape is noise, and what a client sends is no text of ours."""


class MetricsServer(ThreadingHTTPServer):
    """Listens at (host, port); `serve_forever` answers.

    Raises MachineError where the address can't be listened at.
    """

    daemon_threads = True
    # Only so many wait in the kernel; the others are refused there.
    request_queue_size = 16

    def __init__(self, address: tuple[str, int], figures: Figures) -> None:
        self.figures = figures
        self._places = threading.BoundedSemaphore(_AT_ONCE)
        self.address_family = socket.AF_INET6 if ":" in address[0] else socket.AF_INET
        try:
            super().__init__(address, _Handler)
        except OSError as error:
            where = f"{address[0]}:{address[1]}"
            raise MachineError(f"--listen {where}: can't listen there: {error.strerror or error}") from error

    def server_bind(self) -> None:
        """Binds without asking a name server for our name, which could take long in a car."""
        TCPServer.server_bind(self)
        self.server_name, self.server_port = str(self.server_address[0]), int(self.server_address[1])

    def process_request(self, request: Any, client_address: Any) -> None:
        """One connection: at once in a thread of its own, or not at all."""
        if not self._places.acquire(blocking=False):
            self.shutdown_request(request)
            return
        try:
            super().process_request(request, client_address)
        except RuntimeError:
            # The machine is out of threads; the server turns the connection away.
            self._places.release()
            raise

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """The request within its time: slow bytes don't prolong it."""
        end = threading.Timer(_REQUEST_S, _cut, [request])
        end.daemon = True
        end.start()
        try:
            super().process_request_thread(request, client_address)
        finally:
            end.cancel()
            self._places.release()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A client that went away is no news; anything else is a bug, and shown."""
        if not isinstance(sys.exception(), OSError):
            super().handle_error(request, client_address)


def _cut(request: socket.socket) -> None:
    with contextlib.suppress(OSError):
        request.shutdown(socket.SHUT_RDWR)


def listen_address(text: str) -> tuple[str, int]:
    """HOST:PORT; an IPv6 host in brackets. Raises ConfigError.

    >>> listen_address("127.0.0.1:9273"), listen_address("[::1]:80")
    (('127.0.0.1', 9273), ('::1', 80))
    """
    host, _, port = text.rpartition(":")
    bare = host[1:-1] if host.startswith("[") and host.endswith("]") else host
    right = (
        bool(host) and port.isascii() and port.isdigit() and int(port) <= 65535 and (":" not in host or bare != host)
    )
    if not right:
        raise ConfigError(f"--listen {text!r}: expected HOST:PORT, e.g. {DEFAULT_LISTEN} or [::1]:9273")
    return bare, int(port)


def is_open_to_others(host: str) -> bool:
    """Whether others than this machine may reach that host's address, as far as its name tells.

    >>> is_open_to_others("127.0.0.1"), is_open_to_others("localhost"), is_open_to_others("0.0.0.0")
    (False, False, True)
    """
    try:
        return not ip_address(host).is_loopback
    except ValueError:
        return host != "localhost"


def serve_metrics(path: Path, listen: str = DEFAULT_LISTEN) -> None:
    """Answers scrapes until SIGTERM or Ctrl-C.

    Raises ConfigError for an address that is none, MachineError where it can't be listened at.
    """
    server = MetricsServer(listen_address(listen), Figures(path))

    def end(_number: int, _frame: FrameType | None) -> NoReturn:
        raise KeyboardInterrupt

    host = f"[{server.server_name}]" if ":" in server.server_name else server.server_name
    print(f"metrics of {path} at http://{host}:{server.server_port}/metrics", file=sys.stderr, flush=True)
    if is_open_to_others(server.server_name):
        print("note: others on the network can read them; 127.0.0.1 keeps them on this machine", file=sys.stderr)
    before = signal.signal(signal.SIGTERM, end)
    try:
        server.serve_forever(poll_interval=3600.0)
    except KeyboardInterrupt:
        return
    finally:
        signal.signal(signal.SIGTERM, before)
        server.server_close()
