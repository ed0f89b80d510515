"""Mounting, sign and unit mistakes: the run does its job, and what contradicts physics is said at its end."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import pytest
import short_drive as sd
from scenario_results import Called, Replayed
from short_drive import CONFIG, DBC, Sent, edited

pytestmark = pytest.mark.usefixtures("without_report")
Change = Callable[..., Sequence[int]]


class Mistake(NamedTuple):
    """What is wrong (words of a message, configuration or DBC) and what must be said of it."""

    words: str
    can_id: int = 0
    layout: str = ""
    change: Change = lambda *values: values
    config: str = CONFIG
    dbc: str = DBC


def scaled_dbc(names: tuple[str, ...], old: str, new: str) -> str:
    """The DBC with these signals' factor changed, as if it had been written for another unit."""
    lines = DBC.splitlines(keepends=True)
    return "".join(
        edited(line, (f"({old},0)", f"({new},0)"))
        if line.startswith(tuple(f" SG_ {name} :" for name in names))
        else line
        for line in lines
    )


MISTAKES = {
    "accel_x and accel_y swapped": Mistake(
        "accel_x follows the turning and accel_y the speeding up: the two seem swapped",
        sd.ACCELS, "<3h", lambda x, y, z: (y, x, z),
    ),
    "accel_y and accel_z swapped": Mistake(
        "accel_y reads 9.91 m/s^2 on average: that is gravity; are the axes swapped?",
        sd.ACCELS, "<3h", lambda x, y, z: (x, z, y),
    ),
    "accel_x reversed": Mistake(
        "accel_x runs against the wheels' speeding up", sd.ACCELS, "<3h", lambda x, y, z: (-x, y, z)
    ),
    "accel_y reversed": Mistake(
        "accel_y runs against yaw rate times speed", sd.ACCELS, "<3h", lambda x, y, z: (x, -y, z)
    ),
    "accel_z reversed": Mistake(
        "accel_z reads -9.91 m/s^2 on average where +9.81 is expected: sign, unit or axis",
        sd.ACCELS, "<3h", lambda x, y, z: (x, y, -z),
    ),
    "accelerations in g taken for m/s^2": Mistake(
        "accel_z reads 1.01 m/s^2 on average where +9.81 is expected: sign, unit or axis",
        dbc=scaled_dbc(("AX", "AY", "AZ"), "0.002", "0.00020394"),
    ),
    "gyro_z reversed": Mistake(
        "gyro_z runs against the rear wheels' difference", sd.RATES, "<3h", lambda p, q, r: (p, q, -r)
    ),
    "gyro in rad/s taken for deg/s": Mistake(
        "times the yaw rate of the rear wheels: a unit seems wrong (deg/s as rad/s gives 57, the reverse 0.017)",
        dbc=scaled_dbc(("P", "Q", "R"), "0.01", "0.000174533"),
    ),
    "gyro in deg/s taken for rad/s": Mistake(
        "times the yaw rate of the rear wheels: a unit seems wrong (deg/s as rad/s gives 57, the reverse 0.017)",
        config=CONFIG.replace("unit: deg/s", "unit: rad/s"),
    ),
    "wheel speeds in km/h taken for m/s": Mistake(
        "(km/h as m/s gives 0.28, m/s as km/h 3.6)", config=CONFIG.replace("unit: km/h", "unit: m/s")
    ),
    "wheel speeds in m/s taken for km/h": Mistake(
        "(km/h as m/s gives 0.28, m/s as km/h 3.6)",
        dbc=scaled_dbc(("FL", "FR", "RL", "RR"), "0.01", "0.00277778"),
    ),
    "left and right wheels swapped": Mistake(
        "its sign seems reversed, or left and right are swapped",
        sd.WHEELS, ">4H", lambda fl, fr, rl, rr: (fr, fl, rr, rl),
    ),
    "steering reversed": Mistake("gyro_z runs against the steering", sd.STEER, ">h", lambda angle: (-angle,)),
    "the hand wheel's angle taken for the road wheels'": Mistake(
        "(the hand wheel's angle as the road wheels' gives 0.06, the reverse 16)",
        config=CONFIG.replace("steering_wheel_angle:", "road_wheel_angle:"),
    ),
    "a rear wheel's sensor is dead": Mistake(
        "wheel_speed_rl reads 0 while the other wheels turn: a dead sensor?",
        sd.WHEELS, ">4H", lambda fl, fr, rl, rr: (fl, fr, 0, rr),
    ),
    "all wheels' sensors are dead": Mistake(
        "the wheels never turned while gyro_z and accel_x and accel_y moved as in a car that drives: dead sensors?",
        sd.WHEELS, ">4H", lambda fl, fr, rl, rr: (0, 0, 0, 0),
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", MISTAKES)
def test_what_contradicts_physics_is_said(
    dsz: Callable[..., Called], drive: Sequence[Sent], tmp_path: Path, case: str
) -> None:
    mistake = MISTAKES[case]
    change = mistake.change
    sent = sd.words_changed(drive, mistake.can_id, mistake.layout, lambda _t_s, *values: change(*values))
    log, config = sd.write(tmp_path, sent, mistake.config, mistake.dbc)
    called = dsz("replay", log, "-c", config, "-o", tmp_path / "out", "--json")
    assert called.code == 0
    summary: dict[str, Any] = json.loads(called.out)
    assert any(mistake.words in warning for warning in summary["warnings"]), summary["warnings"]


def warnings_of(dsz: Callable[..., Called], folder: Path, sent: Sequence[Sent], config: str = CONFIG) -> list[str]:
    log, config_path = sd.write(folder, sent, config)
    told: list[str] = json.loads(dsz("replay", log, "-c", config_path, "-o", folder / "out", "--json").out)["warnings"]
    return told


def test_a_dead_wheel_is_not_told_as_the_gyros_unit(
    dsz: Callable[..., Called], drive: Sequence[Sent], tmp_path: Path
) -> None:
    """At one speed the other wheel of its axle turns with the car, half as much as both would tell."""
    turns = {}

    def steady(t_s: float, *_: int) -> tuple[int, int, int, int]:
        differ = 0.5 * sd.TRACK_M * 0.15 * math.sin(2.0 * math.pi * t_s / 8.0)
        left, right = (round(3.6 * (15.0 + side * differ) / 0.01) for side in (-1.0, 1.0))
        return left, right, left, turns.get("right", right)

    def turning(t_s: float, p: int, q: int, _: int) -> tuple[int, int, int]:
        return p, q, round(0.15 * math.sin(2.0 * math.pi * t_s / 8.0) / sd.DEG / 0.01)

    sent = sd.words_changed(drive, sd.RATES, "<3h", turning)
    alive = warnings_of(dsz, tmp_path / "alive", sd.words_changed(sent, sd.WHEELS, ">4H", steady))
    assert [words for words in alive if "rear wheels" in words or "reads 0" in words] == []
    turns["right"] = 0
    dead = warnings_of(dsz, tmp_path / "dead", sd.words_changed(sent, sd.WHEELS, ">4H", steady))
    assert any("wheel_speed_rr reads 0 while the other wheels turn" in words for words in dead)
    assert [words for words in dead if "rear wheels" in words] == []


def test_a_wheel_that_stands_for_a_while_is_not_dead(
    dsz: Callable[..., Called], drive: Sequence[Sent], tmp_path: Path
) -> None:
    sent = sd.words_changed(
        drive, sd.WHEELS, ">4H", lambda t_s, fl, fr, rl, rr: (fl, fr, 0 if 7.0 < t_s < 13.0 else rl, rr)
    )
    assert [words for words in warnings_of(dsz, tmp_path, sent) if "reads 0" in words] == []


def test_a_car_that_stands_on_a_slope_has_no_dead_wheels(
    dsz: Callable[..., Called], drive: Sequence[Sent], tmp_path: Path
) -> None:
    sent = sd.words_changed(drive, sd.WHEELS, ">4H", lambda *_: (0, 0, 0, 0))
    sent = sd.words_changed(sent, sd.RATES, "<3h", lambda t_s, *_: (80, -60, 50 + int(1000 * t_s) % 2))
    sent = sd.words_changed(sent, sd.ACCELS, "<3h", lambda t_s, *_: (800 + int(1000 * t_s) % 2, 600, 4800))
    assert [words for words in warnings_of(dsz, tmp_path, sent) if "never turned" in words] == []


def test_nothing_is_said_of_a_good_drive(clean: Replayed) -> None:
    assert clean.summary["warnings"] == []
