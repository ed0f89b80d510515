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
        return f"{self.where}: {self.what}" if self.where else self.what


class DszError(Exception):
    """A failure that the user can mend; `exit_code` is what the process ends with."""

    exit_code = 1

    def __init__(self, message: str, faults: Sequence[Fault] = ()) -> None:
        super().__init__(message)
        self.message = message
        self.faults = tuple(faults)

    def __str__(self) -> str:
        return "\n".join([self.message, *(f"  {fault}" for fault in self.faults)])


class ConfigError(DszError):
    """The command line or the configuration is wrong; found before any bus opens."""

    exit_code = 2


class InputError(DszError):
    """A recording, a DBC or another input file can't be read."""

    exit_code = 3


class MachineError(DszError):
    """A machine or bus failed: no such interface, a full disk, an unwritable folder."""

    exit_code = 4
