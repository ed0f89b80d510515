"""Events to the journal's socket, decoded by the protocol's own description; floods held back and said."""

from __future__ import annotations

import socket
from pathlib import Path

import pytest

from dsz_daemon.edge import journal as journal_room
from dsz_daemon.edge.journal import Journal, Priority


def fields(datagram: bytes) -> dict[str, str]:
    """An entry of systemd's JOURNAL_NATIVE_PROTOCOL."""
    found = {}
    while datagram:
        line, _, rest = datagram.partition(b"\n")
        key, equals, value = line.partition(b"=")
        if not equals:
            length = int.from_bytes(rest[:8], "little")
            value, rest = rest[8 : 8 + length], rest[8 + length + 1 :]
        found[key.decode()] = value.decode()
        datagram = rest
    return found


@pytest.fixture
def receiver(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> socket.socket:
    path = str(tmp_path / "journal")
    monkeypatch.setattr(journal_room, "_JOURNAL", path)
    made = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    made.bind(path)
    made.settimeout(5.0)
    yield made
    made.close()


def test_an_event_arrives_with_its_fields(receiver: socket.socket) -> None:
    journal = Journal(lambda: 0.0, to_journal=True)
    journal.say(Priority.WARNING, "link_down", "bus can0: down\nfor good", 5, {"DSZ_BUS": "can0"})
    assert fields(receiver.recv(4096)) == {
        "PRIORITY": "4",
        "SYSLOG_IDENTIFIER": "dsz",
        "DSZ_EVENT": "link_down",
        "DSZ_BUS": "can0",
        "MESSAGE": "bus can0: down\nfor good",
    }
    journal.close()


def test_a_flood_is_held_back_and_said(capsys: pytest.CaptureFixture[str]) -> None:
    now = [0.0]
    journal = Journal(lambda: now[0], to_journal=False)
    for n in range(100):
        journal.say(Priority.WARNING, "lost", f"lost {n}")
    journal.say(Priority.WARNING, "other", "something else")
    lines = capsys.readouterr().err.splitlines()
    assert lines == [*(f"dsz: lost {n}" for n in range(5)), "dsz: something else"]
    now[0] = 61.0
    journal.say(Priority.WARNING, "lost", "lost again")
    assert capsys.readouterr().err == "dsz: lost again (and 95 more like this)\n"
    assert len(journal.recent) == 50


def test_nobody_at_the_other_end_is_no_failure(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(journal_room, "_JOURNAL", str(tmp_path / "nobody"))
    journal = Journal(lambda: 0.0, to_journal=True)
    journal.say(Priority.ERROR, "x", "still said")
    journal.say(Priority.INFO, "y", "not worth a line by hand")
    assert capsys.readouterr().err == "dsz: still said\n"
    journal.close()
    journal.close()
