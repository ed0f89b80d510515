"""A CAN frame as data: what every source yields and every sink takes."""

from __future__ import annotations

from typing import NamedTuple


class Frame(NamedTuple):
    """One CAN frame.

    `t_ns` is its stamp in integer nanoseconds of the recording's or bus's clock, `channel`
    the bus name that configuration and log use. A remote frame has no data but a length.
    """

    t_ns: int
    channel: str
    can_id: int
    data: bytes
    is_extended: bool = False
    is_fd: bool = False
    is_remote: bool = False
    is_error: bool = False
    fd_flags: int = 0
    remote_length: int = 0
