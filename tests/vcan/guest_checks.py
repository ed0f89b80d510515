"""Inside: the words between a script in the guest and its test (conftest.py). Only the standard library.

One line a check: `ok NAME` or `FAIL NAME: DETAIL`; all other lines are shown where something failed.
"""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable
from typing import Any

# A hang, not a judgement on speed: other work on this machine must not fail a test.
LONG_S = 120.0
# Looking costs too, in a guest with one CPU: a `systemctl show` takes a tenth of a second of it.
_STEP_S = 1.0


class Checks:
    """Makes checks and counts failures; `ends` is the script's exit code."""

    def __init__(self) -> None:
        self._failed = 0
        self._begun_s = time.monotonic()

    def check(self, name: str, passed: object, detail: object = "") -> bool:
        """Says whether something holds; `detail` is shown where it does not."""
        if passed:
            print(f"ok {name}", flush=True)
        else:
            self._failed += 1
            print(f"FAIL {name}: {detail}", flush=True)
        return bool(passed)

    def until(self, name: str, look: Callable[[], Any], timeout_s: float = LONG_S) -> Any:
        """Waits until `look()` is true, and checks that it came to that; returns what it saw last."""
        end_s = time.monotonic() + timeout_s
        while not (seen := look()) and time.monotonic() < end_s:
            time.sleep(_STEP_S)
        self.check(name, seen, f"not within {timeout_s:.0f} s")
        return seen

    def equal(self, name: str, seen: object, expected: object) -> bool:
        """Checks that both are equal, and shows both where they are not."""
        return self.check(name, seen == expected, f"{seen!r}, expected {expected!r}")

    def tell(self, text: str) -> None:
        """A figure worth seeing, with the time since the beginning."""
        print(f"   {time.monotonic() - self._begun_s:6.1f} s  {text}", flush=True)

    def end(self) -> int:
        """The exit code."""
        return 1 if self._failed else 0


def run(script: Callable[[Checks], None], background: Callable[[], str] = str) -> int:
    """Runs a script to its end; an exception in it is a failure with its traceback.

    `background` is asked for what else to show where something failed.
    """
    checks = Checks()
    try:
        script(checks)
    except Exception:
        checks.check("the script ran to its end", False, "an exception")
        traceback.print_exc()
    if checks.end():
        print(background(), flush=True)
    return checks.end()
