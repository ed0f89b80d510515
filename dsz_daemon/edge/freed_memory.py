"""Freed memory is kept for the next array of that size: a system hands it out page by page, which takes longer."""

from __future__ import annotations

import ctypes

_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3
_BYTES = 1 << 28


def keep_freed_memory() -> None:
    """For the rest of this process, for work that makes arrays of some MB by the thousand; without glibc, nothing.

    mallopt(3): the smallest block that is mapped by itself, and how much may lie free at the top.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(_MMAP_THRESHOLD, _BYTES)
        mallopt(_TRIM_THRESHOLD, _BYTES)
