"""A reload: checked in another process, read in a thread, taken over or refused, while the loop goes on."""

from __future__ import annotations

import contextlib
import shutil
import signal
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path

import pytest
from status_cases import golden_setup, last_moment

from dsz_daemon.core.state import EstimatorState
from dsz_daemon.errors import ConfigError
from dsz_daemon.runs import reload as reload_module
from dsz_daemon.runs.facts import LiveFacts
from dsz_daemon.runs.reload import Reload
from dsz_daemon.runs.service import Service
from dsz_daemon.runs.setup import Setup

GOLDEN = Path(__file__).parents[1] / "golden" / "sine_steer"
HANG_S = 120.0


@pytest.fixture
def config(tmp_path: Path) -> Path:
    """A good configuration of one's own."""
    return Path(shutil.copytree(GOLDEN, tmp_path / "mine")) / "config.yaml"


def _with_mass(config: Path, mass: str) -> None:
    lines = config.read_text().splitlines()
    config.write_text("\n".join(f"  mass_kg: {mass}" if "mass_kg:" in line else line for line in lines) + "\n")


def _outcome(reload: Reload) -> Setup | str:
    end_s = time.monotonic() + HANG_S
    with contextlib.closing(reload):
        while (outcome := reload.outcome()) is None:
            assert time.monotonic() < end_s, "it hangs"
            time.sleep(0.01)
    return outcome


def test_a_good_configuration_is_read_and_the_interpreter_is_as_before(config: Path) -> None:
    usual_s = sys.getswitchinterval()
    _with_mass(config, "1234.0")
    outcome = _outcome(Reload(config))
    assert isinstance(outcome, Setup)
    assert outcome.settings.vehicle.mass_kg == 1234.0
    assert sys.getswitchinterval() == usual_s


def test_a_bad_one_is_refused_with_the_words_of_dsz_check(config: Path) -> None:
    _with_mass(config, "-5")
    outcome = _outcome(Reload(config))
    assert isinstance(outcome, str)
    assert "mass_kg" in outcome
    assert "-5" in outcome
    assert "Traceback" not in outcome


def test_one_that_is_gone_is_refused(config: Path) -> None:
    config.unlink()
    assert "config.yaml" in str(_outcome(Reload(config)))


def test_a_check_that_does_not_end_is_ended(config: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reload_module, "_CHECK", "import time; time.sleep(600)")
    reload = Reload(config, timeout_s=0.2)
    assert _outcome(reload) == "the check did not end"


def test_a_check_that_says_more_than_a_pipe_holds_ends(config: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reload_module, "_CHECK", "import sys; sys.stderr.write('x' * 300_000); sys.exit(2)")
    assert _outcome(Reload(config)) == "x" * 300_000


def test_a_check_that_may_not_step_back_checks_all_the_same(config: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As under systemd, where setpriority is not among the system calls."""
    refusing = "import os\ndef nice(n): raise PermissionError(1, 'no')\nos.nice = nice\n"
    monkeypatch.setattr(reload_module, "_CHECK", refusing + reload_module._CHECK)
    assert isinstance(_outcome(Reload(config)), Setup)


def test_what_changes_between_check_and_reading_is_refused(config: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def changed(*_: object, **__: object) -> Setup:
        raise ConfigError("changed meanwhile")

    monkeypatch.setattr(reload_module, "set_up", changed)
    assert _outcome(Reload(config)) == "changed meanwhile"


def test_the_loop_is_not_held_up_while_it_is_read(config: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    reading, go_on = threading.Event(), threading.Event()

    def slow(*_: object, **__: object) -> Setup:
        reading.set()
        assert go_on.wait(HANG_S)
        return golden_setup()

    monkeypatch.setattr(reload_module, "set_up", slow)
    reload = Reload(config)
    end_s = time.monotonic() + HANG_S
    while not reading.is_set() and time.monotonic() < end_s:
        assert reload.outcome() is None
        time.sleep(0.01)
    assert reload.outcome() is None
    go_on.set()
    assert isinstance(_outcome(reload), Setup)


class _Daemon:
    """As much of the loop as a reload needs."""

    def __init__(self, setup: Setup) -> None:
        self.setup = setup
        self.taken: list[Setup] = []

    @property
    def estimator(self) -> EstimatorState:
        raise NotImplementedError

    def facts(self) -> LiveFacts:
        return last_moment()

    def take_over(self, setup: Setup) -> None:
        self.taken.append(setup)
        self.setup = setup


def test_a_reload_asked_for_during_a_reload_is_not_lost(config: Path) -> None:
    """The second one must see what was written after the first had begun."""
    daemon = _Daemon(replace(golden_setup(), path=config))
    service = Service()
    _with_mass(config, "-5")
    end_s = time.monotonic() + HANG_S
    with service:
        service.attend(daemon, 0, True, {signal.SIGHUP})
        _with_mass(config, "1300.0")
        service.attend(daemon, 0, True, {signal.SIGHUP})
        while not daemon.taken and time.monotonic() < end_s:
            service.attend(daemon, 0, True, set())
            time.sleep(0.01)
        kinds = [event.kind for event in service.journal.recent]
    assert [setup.settings.vehicle.mass_kg for setup in daemon.taken] == [1300.0]
    assert kinds.count("reloading") == 2
