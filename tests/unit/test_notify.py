"""Words to a service manager that the test plays."""

from __future__ import annotations

import os
import socket
from pathlib import Path

import pytest

from dsz_daemon.edge.notify import Notify


@pytest.mark.parametrize("abstract", [False, True])
def test_words_arrive(tmp_path: Path, abstract: bool) -> None:
    path = str(tmp_path / "notify")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind("\0" + path if abstract else path)
        manager.settimeout(5.0)
        notify = Notify({"NOTIFY_SOCKET": "@" + path if abstract else path, "WATCHDOG_USEC": "2000000"})
        assert (notify.is_service, notify.watchdog_s) == (True, 2.0)
        notify.say("READY=1", "STATUS=well")
        assert manager.recv(100) == b"READY=1\nSTATUS=well"
        notify.reloading()
        assert manager.recv(100).startswith(b"RELOADING=1\nMONOTONIC_USEC=")
        notify.close()
        notify.say("after the end")


def test_without_a_manager_nothing_is_said_and_nothing_fails(tmp_path: Path) -> None:
    assert not Notify({}).is_service
    Notify({}).say("READY=1")
    gone = Notify({"NOTIFY_SOCKET": str(tmp_path / "gone")})
    gone.say("READY=1")
    gone.close()


@pytest.mark.parametrize(
    ("given", "seconds"),
    [({}, None), ({"WATCHDOG_USEC": "0"}, None), ({"WATCHDOG_USEC": "x"}, None), ({"WATCHDOG_USEC": "500000"}, 0.5)],
)
def test_the_watchdogs_period(given: dict[str, str], seconds: float | None) -> None:
    assert Notify(given).watchdog_s == seconds
    assert Notify({**given, "WATCHDOG_PID": str(os.getpid())}).watchdog_s == seconds
    assert Notify({**given, "WATCHDOG_PID": "1"}).watchdog_s is None
