"""What a process that works with thousands of small arrays asks of memory, collector and linear algebra."""

from __future__ import annotations

import atexit
import ctypes
import gc
import os

_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3
_BYTES = 1 << 28
# Objects that are new, before any is looked at: what makes arrays makes next to no cycles.
_NEW_OBJECTS = 100_000
# OpenBLAS reads it once, when numpy is imported.
_THREADS = "OPENBLAS_NUM_THREADS"


def before_imports() -> None:
    """What has to be asked before numpy is imported, or makes imports quicker."""
    collect_seldom()
    one_thread_for_each_product()


def keep_freed_memory() -> None:
    """For the rest of this process, for work that makes arrays of some MB by the thousand; without glibc, nothing.

    Freed memory is kept for the next array of that size: a system hands it out page by page, which takes longer.
    mallopt(3): the smallest block that is mapped by itself, and how much may lie free at the top.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(_MMAP_THRESHOLD, _BYTES)
        mallopt(_TRIM_THRESHOLD, _BYTES)


def collect_seldom() -> None:
    """For the rest of this process: the collector walks what was imported and made far less often, and not at its end.

    Memory that no cycle holds is freed at once, as ever.
    """
    gc.set_threshold(_NEW_OBJECTS, *gc.get_threshold()[1:])
    atexit.unregister(gc.freeze)
    atexit.register(gc.freeze)


def one_thread_for_each_product() -> None:
    """For whoever imports numpy later: small matrices gain nothing from threads, which then wait for each other.

    What the user has set stays. Side by side is what takes longer than a product.
    """
    os.environ.setdefault(_THREADS, "1")
