"""What surrounds the live loop as a service: state that outlives ignition, systemd, status, reload, the journal.

The loop calls `attend` once a cycle, after its tick is published. Whatever may block (the disk, a
configuration's check) happens in a process of its own.
"""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

from dsz_daemon.core.state import EstimatorState
from dsz_daemon.edge.journal import Journal, Priority
from dsz_daemon.edge.notify import Notify
from dsz_daemon.edge.state_file import load
from dsz_daemon.edge.state_keeper import StateKeeper
from dsz_daemon.edge.status_socket import StatusSocket
from dsz_daemon.errors import DszError
from dsz_daemon.runs.facts import LiveFacts, StateFacts
from dsz_daemon.runs.memory import recalled, remembered
from dsz_daemon.runs.reload import Reload
from dsz_daemon.runs.setup import Setup
from dsz_daemon.runs.status import prepared_versions, snapshot_text, status_line
from dsz_daemon.runs.watchman import Seen, news, seen

_LOOK_S = 0.2
_STATUS_S = 5.0


class Running(Protocol):
    """What a service needs of the loop."""

    @property
    def setup(self) -> Setup:
        """The configuration in force."""
        ...

    @property
    def estimator(self) -> EstimatorState:
        """What is learnt so far."""
        ...

    def facts(self) -> LiveFacts:
        """What there is to tell, but for the state file, reloads and events."""
        ...

    def take_over(self, setup: Setup) -> None:
        """Goes on with another configuration; raises DszError, and goes on as before, where that can't be."""
        ...


@dataclass
class Paths:
    """Where the service keeps things; None: it does not."""

    state: Path | None = None
    status: Path | None = None

    @classmethod
    def of(cls, setup: Setup, environment: Mapping[str, str]) -> Paths:
        """The configured paths, else those in the directories that systemd gave us."""
        service, folder = setup.settings.service, setup.path.parent
        state_folder, run_folder = environment.get("STATE_DIRECTORY"), environment.get("RUNTIME_DIRECTORY")
        state = folder / service.state_file if service.state_file else None
        status = folder / service.status_socket if service.status_socket else None
        if state is None and state_folder:
            state = Path(state_folder.split(":")[0]) / "offsets.json"
        if status is None and run_folder:
            status = Path(run_folder.split(":")[0]) / "status.sock"
        return cls(state, status)


class Service:
    """Use as a context manager round the loop; without paths and without systemd it only watches and says."""

    def __init__(self, paths: Paths | None = None, buses: tuple[str, ...] = ()) -> None:
        self._paths, self._bus_options = paths or Paths(), buses
        self._notify = Notify()
        self.journal = Journal(time.monotonic)
        self._status: StatusSocket | None = None
        self._keeper: StateKeeper | None = None
        self.state_facts = StateFacts(path=str(self._paths.state or ""))
        self._reloads = 0
        self._reload: Reload | None = None
        self._reload_again = False
        self._ready = False
        self._seen: Seen | None = None
        self._pinged_s = self._looked_s = self._told_s = -1e9
        self._saved_s = time.monotonic()

    @property
    def is_service(self) -> bool:
        """Whether systemd (or the like) started us."""
        return self._notify.is_service

    def __enter__(self) -> Service:
        if self._paths.status is not None:
            self._status = StatusSocket(self._paths.status)
            prepared_versions()  # looks into the file system: not in the loop
        if self._paths.state is not None:
            self._keeper = StateKeeper(self._paths.state)
        return self

    def __exit__(self, *_: object) -> None:
        for part in (self._status, self._notify, self.journal):
            if part is not None:
                part.close()
        if self._reload is not None:
            self._reload.close()
        if self._keeper is not None:
            self._keeper.close()

    def restored(self, setup: Setup, now_ns: int) -> EstimatorState | None:
        """What the state file knows of this car and sensor; None where there is nothing to go on with."""
        if self._paths.state is None:
            return None
        loaded = load(self._paths.state)
        for words in loaded.said:
            self.journal.say(Priority.WARNING, "state_file", words, now_ns)
        if loaded.body is None:
            return None
        recall = recalled(setup, loaded.body, now_ns)
        for words in recall.said:
            self.journal.say(Priority.WARNING, "state_file", words, now_ns)
        if recall.estimator is not None:
            self.state_facts.restored_age_s = recall.age_s
            self.journal.say(Priority.NOTICE, "restored", f"{recall.in_words()}, from {self._paths.state}", now_ns)
        return recall.estimator

    def attend(self, running: Running, now_ns: int, healthy: bool, signals: set[signal.Signals]) -> None:
        """Once a cycle, after the tick. `healthy`: a step was made, or none was due."""
        now_s = time.monotonic()
        watchdog_s = self._notify.watchdog_s
        if healthy and watchdog_s is not None and now_s - self._pinged_s >= 0.25 * watchdog_s:
            self._pinged_s = now_s
            self._notify.say("WATCHDOG=1")
        if signal.SIGHUP in signals:
            signals.discard(signal.SIGHUP)
            self._begin_reload(running, now_ns)
        if self._reload is not None:
            self._go_on_reloading(running, self._reload, now_ns)
        if self._status is not None:
            self._status.answer(lambda: snapshot_text(running.setup, self.facts(running)))
        if now_s - self._looked_s >= _LOOK_S:
            self._looked_s = now_s
            self._look(running, now_ns, now_s)
        if self._keeper is not None and now_s - self._saved_s >= running.setup.settings.service.save_period_s:
            self._save(running, now_ns)

    def facts(self, running: Running) -> LiveFacts:
        """Everything there is to tell."""
        return replace(
            running.facts(),
            state_file=self.state_facts,
            reloads=self._reloads,
            events=tuple(self.journal.recent),
        )

    def _look(self, running: Running, now_ns: int, now_s: float) -> None:
        facts = self.facts(running)
        for item in news(self._seen, facts):
            fields = {"DSZ_BUS": item.bus} if item.bus else {}
            self.journal.say(item.priority, item.kind, item.message, now_ns, fields)
        self._seen = seen(facts)
        if not self._ready and facts.phase != "waiting":
            self._ready = True
            self._notify.say("READY=1", f"STATUS={status_line(running.setup, facts)}")
            self._told_s = now_s
        elif now_s - self._told_s >= _STATUS_S:
            self._told_s = now_s
            self._notify.say(f"STATUS={status_line(running.setup, facts)}")
        if self._keeper is not None:
            self._hear_keeper(self._keeper, now_ns)

    def _hear_keeper(self, keeper: StateKeeper, now_ns: int) -> None:
        for outcome in keeper.outcomes():
            if outcome == "saved":
                self.state_facts.saved_ns, self.state_facts.problem = now_ns, ""
            else:
                self.state_facts.problem = outcome
                self.journal.say(Priority.WARNING, "state_file", f"offsets not saved: {outcome}", now_ns)

    def _save(self, running: Running, now_ns: int) -> None:
        if self._keeper is None:
            return
        self._saved_s = time.monotonic()
        row = running.facts().row
        if row is None:
            return
        body = remembered(running.setup, running.estimator, now_ns, row.inputs.get("temperature"))
        if not self._keeper.save(body):
            self.state_facts.problem = "the disk does not keep up"
            self.journal.say(Priority.WARNING, "state_file", "offsets not saved: the disk does not keep up", now_ns)

    def _begin_reload(self, running: Running, now_ns: int) -> None:
        if self._reload is not None:
            # What is read now may be older than what is asked for.
            self._reload_again = True
            return
        self._reload_again = False
        self.journal.say(Priority.NOTICE, "reloading", f"checking {running.setup.path}", now_ns)
        self._notify.reloading()
        try:
            self._reload = Reload(running.setup.path, self._bus_options)
        except OSError as error:
            self._refuse_reload(f"the check did not start: {error.strerror}", now_ns)

    def _go_on_reloading(self, running: Running, reload: Reload, now_ns: int) -> None:
        """While it is checked and read, the old configuration runs; a good new one takes over between two ticks."""
        outcome = reload.outcome()
        if outcome is None:
            return
        self._reload = None
        if isinstance(outcome, str):
            self._refuse_reload(outcome, now_ns)
        else:
            self._take_over(running, outcome, now_ns)
        if self._reload_again:
            self._begin_reload(running, now_ns)

    def _take_over(self, running: Running, setup: Setup, now_ns: int) -> None:
        try:
            running.take_over(setup)
        except DszError as error:
            self._refuse_reload(str(error), now_ns)
            return
        self._reloads += 1
        self.journal.say(Priority.NOTICE, "reloaded", f"{setup.path} taken over", now_ns)
        self._end_reload()

    def _refuse_reload(self, why: str, now_ns: int) -> None:
        self.journal.say(
            Priority.ERROR, "reload_refused", f"the new configuration is refused, the old one goes on: {why}", now_ns
        )
        self._end_reload()

    def _end_reload(self) -> None:
        if self._ready:
            self._notify.say("READY=1")

    def end(self, running: Running, now_ns: int) -> None:
        """The loop has ended: what was learnt is saved, and whoever waits for us is told."""
        self._notify.say("STOPPING=1", "STATUS=stopping")
        if self._keeper is None:
            return
        self._save(running, now_ns)
        if not self._keeper.close():
            self.journal.say(Priority.ERROR, "state_file", f"the last offsets were not saved in {self._paths.state}")


def environment_paths(setup: Setup, state: Path | None, status: Path | None) -> Paths:
    """The command line's paths, else the configuration's, else systemd's."""
    paths = Paths.of(setup, os.environ)
    return Paths(state or paths.state, status or paths.status)
