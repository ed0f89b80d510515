"""The units under a real systemd, in a guest of their own: never this machine's."""

from __future__ import annotations

from collections.abc import Callable

import pytest

pytestmark = [pytest.mark.vcan, pytest.mark.xdist_group("guest")]
# On a quiet machine each takes a minute or two: beyond this it hangs.
LIMIT_S = 500


def test_life_of_the_service(in_guest: Callable[..., list[str]]) -> None:
    """Verified, confined; start, READY, crash, hang, reload good and bad, stop, start again."""
    assert len(in_guest("service_life_checks.py", options=("-s",), time_limit_s=LIMIT_S)) > 40


def test_service_and_its_surroundings(in_guest: Callable[..., list[str]]) -> None:
    """The interface comes and goes; drop-ins, template, metrics, networkd."""
    assert len(in_guest("service_world_checks.py", options=("-s",), time_limit_s=LIMIT_S)) > 25
