"""Scripts that check things on a real vcan, natively or in a guest; what they say becomes a test's result.

A guest boots in some seconds and imports slowly, so a script makes many checks (guest_checks.py) and a
test is one script. Guests never share a CPU (tests/vcan/guest waits for a free one); tests that bring
their own load belong to one xdist_group.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

HERE = Path(__file__).parent
NO_WAY = 77
# Waiting for a free CPU and installing packages come before the guest's own time limit begins.
_BEFORE_S = 600.0


@pytest.fixture
def in_guest() -> Callable[..., list[str]]:
    """Runs a script of this folder in the guest; fails with what it found wrong, skips where there is no way.

    `in_guest("x_checks.py", "argument", options=("-s",), time_limit_s=120)` returns the names of the
    checks that held.
    """

    def run(script: str, *arguments: object, options: tuple[str, ...] = (), time_limit_s: int = 170) -> list[str]:
        command = [str(HERE / "guest"), "-t", str(time_limit_s), *options, sys.executable, str(HERE / script)]
        code, out, err = _run([*command, *map(str, arguments)], time_limit_s + _BEFORE_S)
        if code == NO_WAY:
            pytest.skip(err.strip())
        # Figures, for whoever looks (pytest -s).
        print("\n".join([f"\n{script}:", *(line for line in out.splitlines() if line.startswith("   "))]))
        passed = [line.removeprefix("ok ").strip() for line in out.splitlines() if line.startswith("ok ")]
        wrong = [line for line in out.splitlines() if line.startswith("FAIL ")]
        told = f"{script} in the guest: exit code {code}\n{out}\n{err}"
        assert not wrong, "\n".join([*wrong, "", told])
        assert code == 0, told
        assert passed, f"no check was made: {told}"
        return passed

    return run


def _run(command: list[str], timeout_s: float) -> tuple[int, str, str]:
    """Runs a command in a process group of its own, so that a guest never outlives its test."""
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, errors="replace", start_new_session=True
    )
    try:
        out, err = process.communicate(timeout=timeout_s)
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGTERM)
            process.wait(10.0)
    return process.returncode, out, err
