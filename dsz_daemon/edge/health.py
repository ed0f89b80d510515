"""How each bus is doing, as plain values that status, journal and summary share."""

from __future__ import annotations

from dataclasses import dataclass, fields
from enum import StrEnum


class Link(StrEnum):
    """What a bus's interface is doing, as far as can be seen from here."""

    UP = "up"
    DOWN = "down"
    ABSENT = "absent"
    BUS_OFF = "bus_off"
    ERROR_PASSIVE = "error_passive"


@dataclass(slots=True)
class BusHealth:
    """One bus. Counts only grow.

    `lost`: frames that the kernel dropped because they were not fetched in time (SO_RXQ_OVFL).
    `dropped`: own frames that the interface did not take (queue full, interface down).
    `foreign`: frames with our own output ids that somebody else sent.
    `outages`: how often the interface went down or away. `stamps`: who stamps the frames
    ("hardware", "kernel" or, through python-can, "driver").
    """

    name: str
    interface: str
    link: Link = Link.UP
    stamps: str = "driver"
    received: int = 0
    lost: int = 0
    sent: int = 0
    dropped: int = 0
    error_frames: int = 0
    bus_offs: int = 0
    outages: int = 0
    foreign: int = 0
    last_error: str = ""

    def plain(self) -> dict[str, str | int]:
        """All of it as values that JSON can hold."""
        return {field.name: getattr(self, field.name) for field in fields(self)} | {"link": self.link.value}
