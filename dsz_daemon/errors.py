"""Whose fault it is: configuration, input or machine. Each kind has one exit code.

Anything else that is raised is a bug: it shows its traceback and ends the process, so that
the supervisor restarts it. Bad data on the bus is none of these; it is counted and published.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Fault:
    """One thing that is wrong: where it stands, which value it has, what was expected."""

    where: str
    what: str

    def __str__(self) -> str:
        return _fit_for_a_terminal(f"{self.where}: {self.what}" if self.where else self.what)


def _fit_for_a_terminal(text: str) -> str:
    r"""The same in one line, with what a terminal would obey shown and not sent: names come from files.

    >>> _fit_for_a_terminal("car\x1b[2J.dbc")
    'car\\x1b[2J.dbc'
    """
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text)


class DszError(Exception):
    """A failure that the user can mend; `exit_code` is what the process ends with."""

    exit_code = 1

    def __init__(self, message: str, faults: Sequence[Fault] = ()) -> None:
        super().__init__(message)
        self.message = message
        self.faults = tuple(faults)

    def __str__(self) -> str:
        lines = [_fit_for_a_terminal(line) for line in self.message.split("\n")]
        return "\n".join([*lines, *(f"  {fault}" for fault in self.faults)])


class ConfigError(DszError):
    """The command line or the configuration is wrong; found before any bus opens."""

    exit_code = 2


class InputError(DszError):
    """A recording, a DBC or another input file can't be read."""

    exit_code = 3


class MachineError(DszError):
    """A machine or bus failed: no such interface, a full disk, an unwritable folder."""

    exit_code = 4
