"""A sensor that shows nothing near nothing, or follows only after some play: told with how much that is."""

from __future__ import annotations

import numpy as np
import pytest
from test_diagnose_choices import CITY_STEER, CITY_V, TOLERANCE, N, T, drive, found

from dsz_daemon.diagnose.fitting.fit import fitted
from dsz_daemon.diagnose.residuals.comparison import rows_of
from dsz_daemon.diagnose.shapes.jumps import jump_in, stay_in
from dsz_daemon.diagnose.shapes.own_ways import is_dead_near_nothing, own_ways
from dsz_daemon.diagnose.shapes.uneven_scales import is_of_two
from dsz_daemon.diagnose.shapes.unlisted import best_shape
from dsz_daemon.diagnose.simulation.drive import Drive, nothing
from dsz_daemon.diagnose.simulation.prediction import predicted
from dsz_daemon.diagnose.simulation.road import flat
from dsz_daemon.diagnose.verdict.answer import answered

CHANNEL = {"gyro_z": 2, "accel_x": 3, "accel_y": 4}
OWN = {"gyro_z": "r", "accel_x": "ax", "accel_y": "ay"}


def dead_zone(own: np.ndarray, width: float) -> np.ndarray:
    return np.asarray(np.sign(own) * np.maximum(np.abs(own) - width, 0.0))


def dead_band(own: np.ndarray, width: float) -> np.ndarray:
    return np.asarray(own * (np.abs(own) >= width))


def hysteresis(own: np.ndarray, half_width: float) -> np.ndarray:
    """What a pointer shows that is carried along by a fork so wide."""
    shown, at = [], float(own[0])
    for value in own:
        if value - at > half_width:
            at = value - half_width
        elif at - value > half_width:
            at = value + half_width
        shown.append(at)
    return np.array(shown)


def slew(own: np.ndarray, rate: float) -> np.ndarray:
    """What changes by no more than so much in a second."""
    shown = [float(own[0])]
    for value in own[1:]:
        shown.append(shown[-1] + float(np.clip(value - shown[-1], -0.01 * rate, 0.01 * rate)))
    return np.array(shown)


def high_pass(own: np.ndarray, time_s: float) -> np.ndarray:
    """What a capacitor lets through: it charges to what there is."""
    charge, shown = float(own[0]), []
    for value in own:
        charge += 0.01 / time_s * (value - charge)
        shown.append(value - charge)
    return np.array(shown)


def overflow(own: np.ndarray, end: float) -> np.ndarray:
    """What has too few bits: beyond its end it begins again at the other one."""
    return np.where(own > end, own - 2.0 * end, np.where(own < -end, own + 2.0 * end, own))


def reading(channel: str, does: object, width: float) -> Drive:
    c = CHANNEL[channel]
    own = predicted(drive({}, CITY_V, CITY_STEER), nothing(), flat(N))[:, c]

    def change(one: Drive) -> None:
        one.measured[:, c] += does(own, width) - own  # type: ignore[operator]

    return drive({}, CITY_V, CITY_STEER, change=change)


@pytest.mark.parametrize(
    ("channel", "does", "width", "written", "k"),
    [
        ("gyro_z", dead_zone, 0.02, "k*sat(r/{:.2g})", -0.02),
        ("accel_y", dead_zone, 0.6, "k*sat(ay/{:.2g})", -0.6),
        ("gyro_z", dead_band, 0.03, "k*r where |r| < {:.2g}", -1.0),
        ("accel_y", hysteresis, 0.3, "k*(play(ay, {:.2g})-ay)", 1.0),
        ("accel_x", hysteresis, 0.25, "k*(play(ax, {:.2g})-ax)", 1.0),
        ("gyro_z", slew, 0.06, "k*(slew(r, {:.2g}/s)-r)", 1.0),
        ("accel_y", slew, 0.8, "k*(slew(ay, {:.2g}/s)-ay)", 1.0),
        ("accel_y", overflow, 2.5, "k*(wrap(ay, {:.2g})-ay)", 1.0),
        ("gyro_z", high_pass, 15.0, "k*(r, slowly by {:.2g} s)", -1.0),
    ],
)
def test_what_a_sensor_does_with_what_it_feels_is_told_with_its_width(
    channel: str, does: object, width: float, written: str, k: float
) -> None:
    said = answered(found(reading(channel, does, width)))
    assert said.causes == []
    [shape] = said.unlisted
    assert shape.channel == channel
    near = [written.format(one) for one in width * np.linspace(0.8, 1.25, 200)]
    assert shape.shape in near
    assert shape.coefficient.value == pytest.approx(k, rel=0.15)
    unit = "rad/s" if channel == "gyro_z" else "m/s2"
    assert shape.coefficient.unit == (unit if "sat" in written else f"({unit})/({unit})")


def test_the_width_is_the_one_that_explains_most() -> None:
    own, at = 0.3 * np.sin(0.7 * T), np.arange(0, N, 4)
    for does, name in ((dead_zone, "sat(r/"), (dead_band, "r where |r| < "), (hysteresis, "(play(r, ")):
        left = (does(own, 0.041) - own)[at] + 0.5
        found_now = own_ways("gyro_z", own, left, at)
        [written] = [one for one in found_now if one.startswith(name)]
        width = float(written.removeprefix(name).removesuffix("-r)").removesuffix(")"))
        assert width == pytest.approx(0.041, rel=0.12)
    assert {unit for _, unit in found_now.values()} == {"", "rad/s"}
    # What is finer, or coarser, than what is looked for is something else.
    for width in (0.002, 0.25):
        assert not any("sat" in one for one in own_ways("gyro_z", own, (dead_zone(own, width) - own)[at], at))
    # What shows nothing of its motion is no overflow.
    assert not any("wrap" in one for one in own_ways("gyro_z", own, -own[at], at))
    # Nor are readings of other moments.
    turns = predicted(drive({}, CITY_V, CITY_STEER), nothing(), flat(N))[:, CHANNEL["gyro_z"]]
    for seed in range(8):
        driven = np.random.default_rng(seed).permutation(turns)
        assert not any("wrap" in one for one in own_ways("gyro_z", turns, (driven - turns)[at], at))
    # Nor does what never moves explain anything.
    assert own_ways("accel_y", np.zeros(N), left, at) == {}
    # Nor do what is the other way round, or a small part of it, or far more.
    for k in (-1.0, 0.3, 2.0):
        lost = k * (dead_zone(own, 0.041) - own)[at]
        assert not any(one.startswith("sat(r/0.041") for one in own_ways("gyro_z", own, lost, at))


def test_what_is_dead_near_nothing_is_of_its_own_channel() -> None:
    assert is_dead_near_nothing("sat(r/0.02)", "gyro_z")
    assert is_dead_near_nothing("ay where |ay| < 0.3", "accel_y")
    assert not is_dead_near_nothing("sat(r/0.02)", "accel_y")
    assert not is_dead_near_nothing("(play(ay, 0.3)-ay)", "accel_y")
    assert not is_dead_near_nothing("r where r > 0", "gyro_z")
    assert not is_dead_near_nothing("sat(r/0.02)", "gyro_x")
    # All of these have a width besides how much.
    assert is_of_two("sat(r/0.02)")
    assert is_of_two("ay where |ay| < 0.3")
    assert is_of_two("(play(ax, 0.3)-ax)")
    assert is_of_two("(slew(ay, 0.3/s)-ay)")
    assert is_of_two("(r, slowly by 20 s)")
    assert is_of_two("(wrap(r, 0.3)-r)")
    assert is_of_two("r where r > 0")
    assert not is_of_two("ay*|ay|")
    assert not is_of_two("sign(ay)")


def test_an_offset_that_stays_elsewhere_for_a_while_is_told_with_both_moments() -> None:
    one = drive({}, CITY_V, CITY_STEER)
    one.measured[:, CHANNEL["accel_x"]] += 0.4 * ((T > 18.0) & (T < 33.0))
    rows = rows_of(one)
    shape = best_shape(one, rows, fitted(one, rows, nothing(), (), TOLERANCE))
    assert shape is not None
    assert (shape.channel, shape.shape) == ("accel_x", "k*(18.0 s < t < 33.0 s)")
    assert shape.value == pytest.approx(0.4, rel=0.03)


def test_what_moves_slowly_or_is_short_or_close_to_an_end_stays_nowhere() -> None:
    rng, block, rows = np.random.default_rng(2), np.arange(1500) // 125, np.arange(1500)
    at, noise = 4 * rows, 0.01 * np.random.default_rng(1).normal(size=1500)
    assert stay_in(noise + ((rows > 600) & (rows < 1003)), at, block) == (4 * 601, 4 * 1002 + 1)
    assert stay_in(noise - ((rows > 600) & (rows < 1003)), at, block) == (4 * 601, 4 * 1002 + 1)
    for begin, end in ((600, 800), (600, 660), (100, 800), (700, 1450)):
        assert stay_in(noise + ((rows > begin) & (rows < end)), at, block) is None
    assert stay_in(noise, at, block) is None
    assert stay_in(noise + np.sin(rows / 300.0), at, block) is None
    assert stay_in(noise[:400], at[:400], block[:400]) is None
    # One that jumps once does not come back.
    assert jump_in(noise + ((rows > 600) & (rows < 1003)), at, block) is None
    hertz = np.fft.rfftfreq(6000, 0.04)
    hertz[0] = np.inf
    for _ in range(20):
        flicker = np.fft.irfft(hertz**-0.5 * (rng.normal(size=len(hertz)) + 1j * rng.normal(size=len(hertz))))[:1500]
        assert stay_in(flicker, at, block) is None
