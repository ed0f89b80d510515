"""`dsz metrics`: pages that Prometheus's own parser reads, and a door that nobody can keep open."""

from __future__ import annotations

import contextlib
import http.client
import json
import math
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from prometheus_client.parser import text_string_to_metric_families
from status_cases import FakeDaemon, golden_setup, last_moment, moments

from dsz_daemon import cli
from dsz_daemon.edge.health import BusHealth, Link
from dsz_daemon.errors import ConfigError, MachineError
from dsz_daemon.pipeline.lateness import Lateness
from dsz_daemon.runs import metrics
from dsz_daemon.runs.exposition import Exposition
from dsz_daemon.runs.facts import LiveFacts
from dsz_daemon.runs.metrics import Figures, MetricsServer, is_open_to_others, listen_address
from dsz_daemon.runs.metrics_text import metrics_text
from dsz_daemon.runs.status import snapshot_text

Samples = dict[tuple[str, frozenset[tuple[str, str]]], float]


def parsed(page: str) -> Samples:
    """(name, labels) -> value, by prometheus_client; every family described, no sample twice."""
    found: Samples = {}
    for family in text_string_to_metric_families(page):
        assert family.documentation
        assert family.type in {"gauge", "counter", "histogram"}, family.name
        for sample in family.samples:
            key = sample.name, frozenset(sample.labels.items())
            assert key not in found
            found[key] = float(sample.value)
    return found


def of(found: Samples, name: str, **labels: str) -> float:
    return found[name, frozenset(labels.items())]


def page_of(facts: LiveFacts) -> str:
    return metrics_text(json.loads(snapshot_text(golden_setup(), facts)))


def test_the_page_says_what_the_snapshot_says() -> None:
    facts = last_moment()
    assert facts.row is not None
    found = parsed(page_of(facts))
    assert of(found, "dsz_up") == 1.0
    assert of(found, "dsz_offset_radps", channel="gyro_x") == facts.row.output.gyro_x.offset
    assert of(found, "dsz_offset_std_mps2", channel="accel_z") == facts.row.output.accel_z.offset_std
    assert of(found, "dsz_compensated_mps2", channel="accel_y") == facts.row.output.accel_y.compensated
    assert of(found, "dsz_motion_speed_mps") == facts.row.output.speed_mps
    assert of(found, "dsz_input_mps", role="wheel_speed_fl") == facts.row.inputs["wheel_speed_fl"]
    age_s = facts.row.ages_s["gyro_z"] + (facts.now_ns - facts.row.t_ns) * 1e-9
    assert of(found, "dsz_input_age_seconds", role="gyro_z") == pytest.approx(age_s)
    assert of(found, "dsz_rows_total") == 2400.0
    assert of(found, "dsz_loop_frames_total") == facts.row.counters.frames
    assert of(found, "dsz_message_frames_total", message="WHEEL_SPEEDS", bus="can0") == 1200.0
    assert of(found, "dsz_bus_received_total", bus="can0", interface="socketcan:can0") == facts.buses[0].received
    assert of(found, "dsz_phase", phase="running") == 1.0
    assert of(found, "dsz_phase", phase="silent") == 0.0


def test_a_state_is_one_of_all_states() -> None:
    found = parsed(page_of(replace(last_moment(), buses=(BusHealth("can0", "x", Link.BUS_OFF),))))
    for name in ("dsz_channel_state", "dsz_channel_reason"):
        for channel in ("gyro_x", "accel_z"):
            values = [v for (n, labels), v in found.items() if n == name and ("channel", channel) in labels]
            assert len(values) > 3
            assert sorted(values) == [0.0] * (len(values) - 1) + [1.0]
    assert of(found, "dsz_channel_state", channel="gyro_x", state="converged") == 1.0
    assert of(found, "dsz_bus_link", bus="can0", interface="x", link="bus_off") == 1.0
    assert of(found, "dsz_bus_link", bus="can0", interface="x", link="up") == 0.0


def test_names_and_types_are_prometheus_like() -> None:
    page = page_of(last_moment())
    for family in text_string_to_metric_families(page):
        assert re.fullmatch(r"dsz_[a-z][a-z0-9_]*", family.name)
        # What only grows is a counter and says so; nothing else does.
        for sample in family.samples:
            assert sample.name.endswith("_total") == (family.type == "counter")
    # Each family stands once, as the format asks.
    heads = [line.split()[2] for line in page.splitlines() if line.startswith("# TYPE")]
    assert len(heads) == len(set(heads))
    assert page.endswith("\n")


def test_counters_never_go_back_during_a_drive() -> None:
    before: Samples = {}
    for facts in moments(every=400):
        now = parsed(page_of(facts))
        for (name, labels), value in now.items():
            if name.endswith(("_total", "_bucket", "_count")):
                assert value >= before.get((name, labels), 0.0), name
        before = now


def test_the_histogram_counts_what_was_added() -> None:
    late, times_us = Lateness(), [3.0, 50.0, 99.0, 101.0, 250.0, 900.0, 4_000.0, 40_000.0, 2e6, 5e8]
    for time_us in times_us:
        late.add(time_us)
    found = parsed(page_of(replace(last_moment(), lateness=late)))
    edges = {dict(labels)["le"]: value for (name, labels), value in found.items() if name.endswith("seconds_bucket")}
    assert edges.pop("+Inf") == len(times_us)
    assert len(edges) > 8
    for edge, count in edges.items():
        # The label has four digits of the edge; no time lies that near to one.
        assert count == sum(time_us * 1e-6 <= float(edge) for time_us in times_us), edge
    assert of(found, "dsz_tick_lateness_seconds_count") == len(times_us)
    assert of(found, "dsz_tick_lateness_seconds_sum") == pytest.approx(sum(times_us) * 1e-6)
    assert of(found, "dsz_tick_lateness_max_seconds") == 500.0


def test_what_is_not_known_has_no_sample() -> None:
    facts = last_moment()
    assert facts.row is not None
    yaw = facts.row.output.gyro_z._replace(raw=math.nan, compensated=math.nan)
    row = facts.row._replace(output=facts.row.output._replace(gyro_z=yaw))
    found = parsed(page_of(replace(facts, row=row)))
    assert ("dsz_raw_radps", frozenset({("channel", "gyro_z")})) not in found
    assert of(found, "dsz_offset_radps", channel="gyro_z") == yaw.offset
    nothing = parsed(page_of(replace(facts, row=None, phase="waiting", buses=(), lateness=Lateness())))
    assert of(nothing, "dsz_phase", phase="waiting") == 1.0
    assert not any(name == "dsz_offset_radps" for name, _ in nothing)
    assert parsed(metrics_text(None)) == {("dsz_up", frozenset()): 0.0}


def test_labels_and_helps_are_escaped() -> None:
    page, evil = Exposition(), 'back\\slash "quoted"\nnew line {}= ü'
    page.gauge("dsz_x", "help with \\ and\nnew line", 1.0, {"bus": evil})
    page.counter("dsz_y_total", "none", None)
    page.gauge("dsz_z", "special", math.inf)
    page.gauge("dsz_z", "special", math.nan, {"a": "b"})
    (family, other) = text_string_to_metric_families(page.text())
    assert family.samples[0].labels == {"bus": evil}
    assert family.documentation == "help with \\ and\nnew line"
    assert [math.isinf(other.samples[0].value), math.isnan(other.samples[1].value)] == [True, True]


@contextlib.contextmanager
def served(figures: Figures) -> Iterator[int]:
    """A server on a free port, which is yielded."""
    server = MetricsServer(("127.0.0.1", 0), figures)
    thread = threading.Thread(target=server.serve_forever, args=(0.02,), daemon=True)
    thread.start()
    try:
        yield server.server_port
    finally:
        server.shutdown()
        server.server_close()
        thread.join(10.0)


def got(port: int, path: str = "/metrics", method: str = "GET") -> tuple[int, dict[str, str], str]:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=30.0)
    with contextlib.closing(connection):
        connection.request(method, path)
        response = connection.getresponse()
        return response.status, dict(response.getheaders()), response.read().decode()


def test_a_scrape(tmp_path: Path) -> None:
    with FakeDaemon(tmp_path / "s"), served(Figures(tmp_path / "s")) as port:
        status, headers, page = got(port)
        assert status == 200
        assert headers["Content-Type"] == "text/plain; version=0.0.4; charset=utf-8"
        assert int(headers["Content-Length"]) == len(page.encode())
        assert of(parsed(page), "dsz_up") == 1.0
        assert got(port, "/metrics?x=y")[0] == 200
        assert got(port, "/")[::2] == (200, "dsz: see /metrics\n")
        assert got(port, "/metrics", "HEAD")[::2] == (200, "")
        assert [got(port, path)[0] for path in ("/other", "/../etc/passwd", "/metrics/x")] == [404] * 3
        # Read-only: there is nothing else that one can do.
        assert [got(port, "/metrics", method)[0] for method in ("POST", "PUT", "DELETE")] == [501] * 3


def test_up_follows_the_daemon(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(metrics, "_FRESH_S", 0.0)
    figures = Figures(tmp_path / "s")
    assert figures.page().endswith("dsz_up 0.0\n")
    with FakeDaemon(tmp_path / "s"):
        assert of(parsed(figures.page()), "dsz_up") == 1.0
    assert parsed(figures.page()) == {("dsz_up", frozenset()): 0.0}


def test_many_scrapes_ask_the_daemon_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(metrics, "_FRESH_S", 3600.0)
    with FakeDaemon(tmp_path / "s") as daemon, served(Figures(tmp_path / "s")) as port:
        assert len({got(port)[2] for _ in range(50)}) == 1
        assert daemon.answered == 1


def closed_within(client: socket.socket, seconds: float) -> bool:
    client.settimeout(seconds)
    try:
        while client.recv(65536):
            pass
    except TimeoutError:
        return False
    except OSError:
        return True
    return True


def test_slow_clients_are_cut_and_keep_nobody_waiting(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One byte now and then prolongs nothing: the time is that of the whole request."""
    monkeypatch.setattr(metrics, "_REQUEST_S", 0.5)
    with FakeDaemon(tmp_path / "s"), served(Figures(tmp_path / "s")) as port, contextlib.ExitStack() as stack:
        slow = [stack.enter_context(socket.create_connection(("127.0.0.1", port))) for _ in range(5)]
        for client in slow:
            client.send(b"GET /metrics HTTP/1.1\r\nX: ")
        assert got(port)[0] == 200
        deadline_s, alive = time.monotonic() + 30.0, list(slow)
        while alive and time.monotonic() < deadline_s:
            time.sleep(0.05)
            for client in list(alive):
                try:
                    client.send(b"x")
                except OSError:
                    alive.remove(client)
        assert not alive
        assert got(port)[0] == 200


def test_more_at_once_than_there_are_places_are_turned_away(tmp_path: Path) -> None:
    with FakeDaemon(tmp_path / "s"), served(Figures(tmp_path / "s")) as port, contextlib.ExitStack() as stack:
        before = threading.active_count()
        idle = [stack.enter_context(socket.create_connection(("127.0.0.1", port))) for _ in range(60)]
        turned_away = [closed_within(client, 5.0) for client in idle[-20:]]
        assert turned_away == [True] * 20
        # A thread and a timer for each of eight, whatever comes.
        assert threading.active_count() - before <= 16
        for client in idle:
            client.close()
        deadline_s = time.monotonic() + 30.0
        while time.monotonic() < deadline_s:
            with contextlib.suppress(OSError, http.client.HTTPException):
                if got(port)[0] == 200:
                    break
        else:
            pytest.fail("the places were never free again")


@pytest.mark.parametrize(
    "request_bytes",
    [
        b"\x00\xff" * 5000,
        b"GET " + b"x" * 200_000 + b" HTTP/1.1\r\n\r\n",
        b"GET /metrics HTTP/1.1\r\n" + b"A: b\r\n" * 1000 + b"\r\n",
        b"GET /metrics HTTP/9.9\r\n\r\n",
        b"GET\r\n\r\n",
        b"",
    ],
)
def test_requests_that_are_none(
    tmp_path: Path, request_bytes: bytes, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(metrics, "_REQUEST_S", 2.0)
    with FakeDaemon(tmp_path / "s"), served(Figures(tmp_path / "s")) as port:
        with socket.create_connection(("127.0.0.1", port)) as client:
            with contextlib.suppress(OSError):
                client.sendall(request_bytes)
                client.shutdown(socket.SHUT_WR)
            assert closed_within(client, 30.0)
        assert got(port)[0] == 200
    assert capsys.readouterr().err == ""


def test_a_client_that_goes_away_is_no_news_but_a_bug_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    figures = Figures(tmp_path / "s")
    monkeypatch.setattr(figures, "page", lambda: 1 / 0)
    with served(figures) as port:
        with contextlib.suppress(OSError, http.client.HTTPException):
            got(port)
        assert got(port, "/")[0] == 200
    assert "ZeroDivisionError" in capsys.readouterr().err


@pytest.mark.parametrize(
    "text", ["", "9273", ":9273", "localhost", "localhost:", "localhost:x", "localhost:65536", "localhost:-1", "::1:80"]
)
def test_addresses_that_are_none(text: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(ConfigError, match=r"expected HOST:PORT"):
        listen_address(text)
    assert cli.main(["metrics", f"--listen={text}"]) == 2
    assert "--listen" in capsys.readouterr().err


def test_addresses() -> None:
    assert listen_address("[2001:db8::1]:1") == ("2001:db8::1", 1)
    assert listen_address("car.local:65535") == ("car.local", 65535)
    assert [is_open_to_others(host) for host in ("::1", "127.9.9.9", "::", "192.0.2.1", "car.local")] == [
        False,
        False,
        True,
        True,
        True,
    ]


def test_an_address_that_is_taken_is_a_machine_error(tmp_path: Path) -> None:
    with served(Figures(tmp_path / "s")) as port, pytest.raises(MachineError, match=f"127.0.0.1:{port}: can't listen"):
        MetricsServer(("127.0.0.1", port), Figures(tmp_path / "s"))


def test_the_process_serves_and_ends_on_sigterm(tmp_path: Path) -> None:
    command: list[Any] = [sys.executable, "-m", "dsz_daemon", "metrics", "--listen", "127.0.0.1:0"]
    with (
        FakeDaemon(tmp_path / "s"),
        subprocess.Popen([*command, "--socket", tmp_path / "s"], stderr=subprocess.PIPE, text=True) as process,
    ):
        assert process.stderr is not None
        said = process.stderr.readline()
        port = re.search(r"http://127\.0\.0\.1:(\d+)/metrics", said)
        assert port, said
        assert of(parsed(got(int(port[1]))[2]), "dsz_up") == 1.0
        process.send_signal(signal.SIGTERM)
        _, rest = process.communicate(timeout=30.0)
    assert (process.returncode, rest) == (0, "")
