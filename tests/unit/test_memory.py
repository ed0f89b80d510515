"""What is taken over from a saved state: only what fits the car and sensor at hand, can be true, and with its age."""

from __future__ import annotations

import copy
import json
import math
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from core_cases import DEG, drive, straight

from dsz_daemon.core import zeroing
from dsz_daemon.core.reachable import smallest_variance, unreachable_stiffness, unreachable_zeroing
from dsz_daemon.core.state import EstimatorState, from_plain, initial_state, resumed
from dsz_daemon.core.stiffness import StiffnessState, adapted, initial_stiffness
from dsz_daemon.core.zeroing import ZeroingState
from dsz_daemon.edge.boot import Boot, this_boot
from dsz_daemon.edge.state_file import decoded, encoded
from dsz_daemon.runs.memory import Recall, recalled, remembered
from dsz_daemon.runs.setup import Setup, set_up
from dsz_daemon.signals import ACCEL_CHANNELS, GYRO_CHANNELS, IMU_CHANNELS

CAR = Path(__file__).parents[1] / "golden" / "sine_steer"
HOUR_S, DAY_S = 3600.0, 86400.0
# 2026-03-01 and two runs of a machine.
NOW_NS = 1_772_323_200_000_000_000
MORNING, EVENING = Boot("first", 50_000_000_000), Boot("second", 20_000_000_000)

# Its id, were it made of the digits, would be as long.
HUGE = pytest.param(10**5000, id="huge")

Edit = Callable[[dict[str, Any]], None]


def configured(folder: Path, edit: Edit = lambda _: None, dbc: tuple[str, str] = ("", "")) -> Setup:
    """The simulated car's configuration after `edit`; in its DBC files the one text is put for the other."""
    folder.mkdir(exist_ok=True)
    for name in ("car.dbc", "imu.dbc"):
        text = (CAR / name).read_text()
        (folder / name).write_text(text.replace(*dbc) if dbc[0] else text)
    data = yaml.safe_load((CAR / "config.yaml").read_text())
    edit(data)
    (folder / "config.yaml").write_text(yaml.safe_dump(data))
    return set_up(folder / "config.yaml")


@pytest.fixture(scope="module")
def setup(tmp_path_factory: pytest.TempPathFactory) -> Setup:
    return configured(tmp_path_factory.mktemp("car"))


@pytest.fixture(scope="module")
def learnt(setup: Setup) -> EstimatorState:
    """After 40 s of straight road: all six channels have moved, and a block is half done."""
    reading = straight(20.0, gyro_x=0.01, gyro_y=-0.02, gyro_z=0.005, accel_x=0.1, accel_y=-0.2)
    state, _ = drive(reading, 42.0, dt_s=0.05, tuning=setup.settings.estimator.tuning())
    assert all(channel.correction != 0.0 and channel.block_s > 0.0 for channel in state[:6])
    return state._replace(stiffness=state.stiffness._replace(front=1.1, rear=0.95, p11=0.004, p12=0.001, p22=0.003))


def saved(
    setup: Setup, state: EstimatorState, boot: Boot = MORNING, temperature: float | None = None
) -> dict[str, Any]:
    """A body that went through a file."""
    return decoded(encoded(remembered(setup, state, NOW_NS, temperature, boot)))


def later(setup: Setup, body: dict[str, Any], seconds: float) -> Recall:
    """Recalled within the same run of the machine."""
    later_ns = round(seconds * 1e9)
    return recalled(setup, body, NOW_NS + later_ns, MORNING._replace(elapsed_ns=MORNING.elapsed_ns + later_ns))


def estimator(recall: Recall) -> EstimatorState:
    assert recall.estimator is not None
    return recall.estimator


def test_a_restart_at_once_goes_on_as_resumed_says(setup: Setup, learnt: EstimatorState) -> None:
    recall = later(setup, saved(setup, learnt), 0.0)
    assert repr(recall.estimator) == repr(resumed(learnt, setup.settings.estimator.tuning(), 0.0))
    assert recall == (recall.estimator, 0.0, (), IMU_CHANNELS, None)


@pytest.mark.parametrize(
    ("hours", "gyro_degps", "accel_mps2"),
    [
        # sqrt(0.05^2 + (0.5 (1 - e^-0.5))^2 + 4e-6 * 600), sqrt(0.2^2 + (0.2 (1 - e^-0.5))^2 + 3e-6 * 600)
        (600.0 / 3600.0, 0.208817, 0.219072),
        # sqrt(0.05^2 + (0.5 (1 - e^-3))^2 + 4e-6 * 3600) and so on
        (1.0, 0.492571, 0.294816),
        (8.0, 0.606383, 0.407922),
        (24.0, 0.773369, 0.582409),
        # The data sheet's spread: no more than that is ever unknown.
        (24.0 * 60.0, 3.0, 1.0),
    ],
)
def test_the_spread_after_parking(
    setup: Setup, learnt: EstimatorState, hours: float, gyro_degps: float, accel_mps2: float
) -> None:
    gyro, accel = ZeroingState(0.01, (0.05 * DEG) ** 2), ZeroingState(0.1, 0.2**2)
    state = learnt._replace(**dict.fromkeys(GYRO_CHANNELS, gyro), **dict.fromkeys(ACCEL_CHANNELS, accel))
    recall = later(setup, saved(setup, state), hours * 3600.0)
    assert recall.age_s == pytest.approx(hours * 3600.0)
    for name in IMU_CHANNELS:
        channel = getattr(estimator(recall), name)
        expected = gyro_degps * DEG if name in GYRO_CHANNELS else accel_mps2
        assert math.sqrt(channel.variance) == pytest.approx(expected, rel=1e-4), name
        assert channel.correction == getattr(state, name).correction


def test_without_a_parking_spread_only_the_drift_counts(tmp_path: Path, learnt: EstimatorState) -> None:
    none = {"service": {"parked_gyro_std_degps": 0.0, "parked_accel_std_mps2": 0.0}}
    setup = configured(tmp_path / "car", lambda data: data.update(none))
    recall = later(setup, saved(setup, learnt), 3600.0)
    assert repr(recall.estimator) == repr(resumed(learnt, setup.settings.estimator.tuning(), 3600.0))


def test_motion_starts_afresh(setup: Setup, learnt: EstimatorState) -> None:
    state = estimator(later(setup, saved(setup, learnt), 1.0))
    fresh = initial_state(setup.settings.estimator.tuning())
    assert (state.speed, state.observer, state.attitude) == (fresh.speed, fresh.observer, fresh.attitude)
    assert repr(state.transient) == repr(fresh.transient)


@pytest.mark.parametrize(
    ("since_s", "boot", "age_s", "why"),
    [
        # The same run of the machine: its steady clock counts, whatever the time of day says.
        (100.0, Boot("first", 150_000_000_000), 100.0, ""),
        (-5000.0, Boot("first", 150_000_000_000), 100.0, ""),
        (1e9, Boot("first", 150_000_000_000), 100.0, ""),
        # Without ids: both clocks ran on alike.
        (100.0, Boot("", 150_500_000_000), 100.5, ""),
        # Another run: the time of day, if it ran on while the machine was off.
        (3600.0, EVENING, 3600.0, ""),
        (3600.0, Boot("", 20_000_000_000), 3600.0, ""),
        (30 * DAY_S, EVENING, 30 * DAY_S, ""),
        # 150 s later, 20 s after the start: it was off for 130 s.
        (150.0, EVENING, 150.0, ""),
        (130.0, EVENING, 30 * DAY_S, "stood still"),
        (21.0, EVENING, 30 * DAY_S, "stood still"),
        (-7200.0, EVENING, 30 * DAY_S, "2 h ahead"),
        # A clock that was never set.
        (-NOW_NS * 1e-9 + 60.0, EVENING, 30 * DAY_S, "not set"),
    ],
)
def test_the_age(setup: Setup, learnt: EstimatorState, since_s: float, boot: Boot, age_s: float, why: str) -> None:
    recall = recalled(setup, saved(setup, learnt), NOW_NS + round(since_s * 1e9), boot)
    assert recall.age_s == pytest.approx(age_s)
    assert len(recall.said) == bool(why)
    assert why in "".join(recall.said)
    assert recall.taken == IMU_CHANNELS


def test_a_state_of_before_the_clock_was_set(setup: Setup, learnt: EstimatorState) -> None:
    body = saved(setup, learnt) | {"saved_ns": 1_000_000_000_000}
    recall = recalled(setup, body, NOW_NS, EVENING)
    assert recall.age_s == 30 * DAY_S
    assert "the clock was not set" in recall.said[0]
    tuning = setup.settings.estimator.tuning()
    assert estimator(recall).gyro_z.variance == pytest.approx(tuning.gyro_z.prior_std**2)


@pytest.mark.parametrize("time", [None, "2026", 1.5, True, -1, 1 << 63, HUGE, [1], {}])
def test_a_time_that_is_none(setup: Setup, learnt: EstimatorState, time: object) -> None:
    for change in ({"saved_ns": time}, {"boot": {"id": "first", "elapsed_ns": time}}, {"boot": time}):
        recall = recalled(setup, saved(setup, learnt) | change, NOW_NS, MORNING)
        assert recall.age_s == 30 * DAY_S
        assert "its time makes no sense" in recall.said[0]
        assert recall.taken == IMU_CHANNELS


def test_this_machine_s_run_goes_on() -> None:
    first, second = this_boot(), this_boot()
    assert first.id == second.id
    assert 0 < first.elapsed_ns <= second.elapsed_ns


def signal_edit(role: str, **changed: Any) -> Edit:
    return lambda data: data["signals"][role].update(changed)


CHANGES: dict[str, tuple[Edit, tuple[str, str], set[str], str]] = {
    "sign": (signal_edit("gyro_x", sign=-1), ("", ""), {"gyro_x"}, "sign"),
    "unit": (signal_edit("accel_x", unit="m/s^2"), ("", ""), {"accel_x"}, "to_si"),
    "sensitivity": (signal_edit("gyro_y", volts_per_unit=0.006), ("", ""), {"gyro_y"}, "adc"),
    "null": (signal_edit("gyro_y", null_volts=2.4), ("", ""), {"gyro_y"}, "adc"),
    "bus": (signal_edit("accel_z", channel="can0"), ("", ""), {"accel_z"}, "channel"),
    "signal": (signal_edit("gyro_x", signal="PITCH_ADC"), ("", ""), {"gyro_x"}, "signals"),
}


def start_of(recall: Recall, name: str) -> str:
    """What was said of one channel."""
    return next((words for words in recall.said if words.startswith(f"{name}:")), "")


def is_anew(setup: Setup, recall: Recall, name: str) -> bool:
    law = getattr(setup.settings.estimator.tuning(), name)
    return getattr(recall.estimator, name) == zeroing.unlearnt(law) and name not in recall.taken


@pytest.mark.parametrize("change", CHANGES)
def test_a_channel_that_is_read_otherwise_starts_anew(
    setup: Setup, learnt: EstimatorState, tmp_path: Path, change: str
) -> None:
    edit, dbc, changed, why = CHANGES[change]
    # Two roles on one signal are a fault of the configuration: then the other one goes.
    if change == "signal":
        edit = lambda data: (signal_edit("gyro_x", signal="PITCH_ADC")(data), data["signals"].pop("gyro_y"))  # noqa: E731
    other = configured(tmp_path / "car", edit, dbc)
    recall = later(other, saved(setup, learnt), 1.0)
    for name in other.channels:
        assert is_anew(other, recall, name) == (name in changed), name
        assert (f"({why})" in start_of(recall, name)) == (name in changed)
    assert estimator(recall).stiffness.front == 1.1


def dbc_line(name: str, which: str) -> str:
    return next(line for line in (CAR / name).read_text().splitlines() if which in line)


def test_a_changed_dbc_counts_too(setup: Setup, learnt: EstimatorState, tmp_path: Path) -> None:
    """Bits, sign, scale and offset of one signal, the message's id."""
    roll, message = dbc_line("imu.dbc", " ROLL_ADC "), dbc_line("imu.dbc", " IMU_RATE:")
    number = message.split()[1]
    cases = [
        (roll, roll.replace("(1,0)", "(2,0)"), {"gyro_x"}),
        (roll, roll.replace("(1,0)", "(1,-5)"), {"gyro_x"}),
        (roll, roll.replace("+ (", "- ("), {"gyro_x"}),
        (roll, roll.replace("|16@", "|15@"), {"gyro_x"}),
        (message, message.replace(number, str(int(number) + 1)), set(GYRO_CHANNELS)),
    ]
    for k, (old, new, changed) in enumerate(cases):
        assert old != new, (k, old)
        other = configured(tmp_path / str(k), dbc=(old, new))
        recall = later(other, saved(setup, learnt), 1.0)
        assert {name for name in IMU_CHANNELS if is_anew(other, recall, name)} == changed, k
        # The stiffness was learnt from the yaw rate.
        assert (estimator(recall).stiffness.front == 1.1) == ("gyro_z" not in changed)


def test_another_sensor_starts_anew(tmp_path: Path, learnt: EstimatorState) -> None:
    def named(name: str) -> Setup:
        return configured(tmp_path / name, lambda data: data.update(service={"sensor": name}))

    first, second = named("A1"), named("A2")
    same, other = later(first, saved(first, learnt), 1.0), later(second, saved(first, learnt), 1.0)
    assert same.taken == IMU_CHANNELS
    assert same.said == ()
    assert all(is_anew(second, other, name) for name in IMU_CHANNELS)
    assert other.said == ("service.sensor is 'A2', the offsets are those of 'A1': all are learnt anew",)
    assert estimator(other).stiffness.front == 1.1


def test_another_car_learns_its_tyres_anew(setup: Setup, learnt: EstimatorState, tmp_path: Path) -> None:
    other = configured(tmp_path / "car", lambda data: data["vehicle"].update(mass_kg=1900.0))
    recall = later(other, saved(setup, learnt), 1.0)
    assert recall.taken == IMU_CHANNELS
    assert estimator(recall).stiffness[:9] == initial_stiffness(other.settings.estimator.tuning())[:9]
    assert len(recall.said) == 1
    assert "(vehicle.mass_kg)" in recall.said[0]


@pytest.mark.parametrize("role", ["gyro_z", "accel_y", "steering_wheel_angle"])
def test_tyres_learnt_by_another_reading_are_learnt_anew(
    setup: Setup, learnt: EstimatorState, tmp_path: Path, role: str
) -> None:
    """A yaw rate of the wrong sign gives tyres that no car has."""
    other = configured(tmp_path / "car", signal_edit(role, sign=-1))
    recall = later(other, saved(setup, learnt), 1.0)
    assert estimator(recall).stiffness.front == 1.0
    assert any(words.startswith("cornering stiffness:") and f"({role})" in words for words in recall.said)


def test_a_channel_that_was_not_mapped_before(setup: Setup, learnt: EstimatorState, tmp_path: Path) -> None:
    before = configured(tmp_path / "car", lambda data: data["signals"].pop("accel_z"))
    assert set(saved(before, learnt)["channels"]) == {*IMU_CHANNELS} - {"accel_z"}
    recall = later(setup, saved(before, learnt), 1.0)
    assert is_anew(setup, recall, "accel_z")
    assert start_of(recall, "accel_z").startswith("accel_z: nothing was saved of it")
    recall = later(before, saved(setup, learnt), 1.0)
    assert recall.taken == IMU_CHANNELS[:5]
    assert estimator(recall).accel_z.correction == 0.0


# A state file may be swapped or forged: nothing that the estimator could not have come to by itself is believed.

DEEP: list[Any] = []
for _ in range(300):
    DEEP = [DEEP]

POISON: list[Any] = [
    ("correction", 31.0 * DEG),
    ("correction", -31.0 * DEG),
    ("correction", math.nan),
    ("correction", math.inf),
    pytest.param("correction", 10**5000, id="huge"),
    ("correction", "0.1"),
    ("correction", None),
    ("correction", True),
    ("correction", [0.1]),
    ("correction", DEEP),
    ("correction", {"x": 1}),
    ("variance", 0.0),
    ("variance", -1e-6),
    ("variance", 1e-12),
    ("variance", (31.0 * DEG) ** 2),
    ("variance", 1e300),
    ("variance", math.nan),
    ("driven_s", -1.0),
    ("driven_s", math.inf),
    ("block_s", -1.0),
    ("block_s", 5e-324),
    ("block_sum", 1e6),
    ("block_variance", 0.0),
    ("block_variance", -1.0),
    ("noise_sum", -1.0),
    ("noise_sum", 1e6),
    ("noise_sum", math.nan),
    ("noise_blocks", -0.5),
    ("noise_blocks", 1e9),
    ("neglected", 31.0 * DEG),
    ("neglected", -31.0 * DEG),
    ("neglected", math.nan),
]


@pytest.mark.parametrize(("field", "value"), POISON)
def test_a_poisoned_channel_is_refused_and_the_others_are_not(
    setup: Setup, learnt: EstimatorState, field: str, value: Any
) -> None:
    body = remembered(setup, learnt, NOW_NS, None, MORNING)
    body["channels"]["gyro_z"]["learnt"][field] = value
    recall = later(setup, body, 1.0)
    assert is_anew(setup, recall, "gyro_z")
    assert recall.taken == tuple(name for name in IMU_CHANNELS if name != "gyro_z")
    assert len(recall.said) == 1
    assert recall.said[0].startswith("gyro_z: what was saved ")
    assert len(recall.said[0]) < 400


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("front", 2.0),
        ("rear", 0.5),
        ("rear", math.nan),
        ("front", "1"),
        ("steering_zero_rad", 0.2),
        ("p11", 0.0),
        ("p11", -0.01),
        ("p22", 0.02),
        ("p33", math.inf),
        ("p12", 0.01),
        ("p13", 1e-3),
        ("p23", -1e-3),
        ("smoothed_ay_mps2", []),
    ],
)
def test_poisoned_tyres_are_refused(setup: Setup, learnt: EstimatorState, field: str, value: Any) -> None:
    body = remembered(setup, learnt, NOW_NS, None, MORNING)
    body["stiffness"]["learnt"][field] = value
    recall = later(setup, body, 1.0)
    assert recall.taken == IMU_CHANNELS
    assert estimator(recall).stiffness.front == 1.0
    assert recall.said[0].startswith("cornering stiffness: what was saved ")


def test_correlations_that_can_t_be_together_are_refused(setup: Setup) -> None:
    """Each of 0.9 is possible, but not a ~ b, b ~ c and a ~ -c."""
    tuning = setup.settings.estimator.tuning()
    s = initial_stiffness(tuning)
    p12, p13 = 0.9 * s.p11, 0.9 * math.sqrt(s.p11 * s.p33)
    assert unreachable_stiffness(s._replace(p12=p12, p13=p13, p23=p13), tuning) == ""
    assert "covariance" in unreachable_stiffness(s._replace(p12=p12, p13=p13, p23=-p13), tuning)


@pytest.mark.parametrize("part", ["channels", "stiffness", "sensor", "temperature_degc", "boot", "saved_ns"])
@pytest.mark.parametrize("value", [None, 7, "x", [], {}, DEEP, {"gyro_x": None, "source": 3, "learnt": []}])
def test_a_body_of_another_shape_never_raises(setup: Setup, learnt: EstimatorState, part: str, value: Any) -> None:
    recall = later(setup, saved(setup, learnt) | {part: copy.copy(value)}, 1.0)
    assert recall.age_s > 0.0
    if part == "channels":
        assert recall.taken == ()


@pytest.mark.parametrize("value", [None, 7, [], {}, {"message": 3}, DEEP])
def test_a_source_of_another_shape_is_another_source(setup: Setup, learnt: EstimatorState, value: Any) -> None:
    body = saved(setup, learnt)
    body["channels"]["accel_x"]["source"] = value
    body["stiffness"]["source"] = value
    recall = later(setup, body, 1.0)
    assert is_anew(setup, recall, "accel_x")
    assert estimator(recall).stiffness.front == 1.0


def test_an_empty_body_gives_nothing_to_go_on_with(setup: Setup) -> None:
    recall = recalled(setup, {}, NOW_NS, MORNING)
    assert recall.estimator is None
    assert recall.taken == ()
    assert recall.in_words() == "no offset was taken over"


def test_a_believable_poison_is_unlearnt_as_quickly_as_an_honest_error(setup: Setup, learnt: EstimatorState) -> None:
    """The worst that is believed: the largest offset, as sure as can be. At rest the yaw rate gives it the lie.

    Surest and at rest the gain is k = sqrt(Q/S) = sqrt(4e-6/0.005) 1/s: 30 deg/s exp(-k t) = 0.05 deg/s after 226 s.
    """
    tuning = setup.settings.estimator.tuning()
    law = tuning.gyro_z
    worst = ZeroingState(-law.largest_offset, smallest_variance(law))
    recall = later(setup, saved(setup, learnt._replace(gyro_z=worst)), 0.0)
    assert "gyro_z" in recall.taken
    after = math.log(30.0 / 0.05) / math.sqrt(4e-6 / 0.005)
    assert after == pytest.approx(226.0, abs=0.5)
    state, _ = drive(straight(0.0), 10.0 + after, dt_s=0.1, tuning=tuning, state=estimator(recall))
    assert abs(state.gyro_z.correction) < 0.06 * DEG


@pytest.mark.parametrize("printed", [False, True])
@pytest.mark.parametrize("name", IMU_CHANNELS)
def test_what_a_law_comes_to_is_never_refused(setup: Setup, name: str, printed: bool) -> None:
    """Six hours at rest, six of the calmest road, one of the roughest: as sure and as unsure as it gets."""
    settings = setup.settings.estimator.model_copy(update={"as_printed": printed})
    tuning = settings.tuning()
    law = getattr(tuning, name)
    c = tuning.c_y if name == "accel_y" else 1.0
    state = zeroing.unlearnt(law)
    for seconds, dt_s, standstill, size in (
        (6 * HOUR_S, 10.0, True, 0.0),
        (6 * HOUR_S, 2.5, False, 0.0),
        (HOUR_S, 0.5, False, law.largest_offset),
        (6 * HOUR_S, 5.0, False, 0.0),
    ):
        for k in range(round(seconds / dt_s)):
            target = size if k // 30 % 2 else -size
            state = zeroing.zeroed(state, target, standstill, law, printed, tuning.block_s, dt_s, c)
            assert unreachable_zeroing(state, law, c, tuning.block_s) == ""


def test_a_law_whose_single_look_tells_more_than_the_steady_state(setup: Setup) -> None:
    """A look of 0.01 and a steady state of sqrt(Q S) = sqrt(1e-4 * 1) = 0.1^2: the look is surer."""
    law = setup.settings.estimator.tuning().accel_z._replace(
        look_std=0.01, drift_density=1e-4, noise_density=1.0, noise_blocks=1e15, standstill_density=1.0
    )
    assert smallest_variance(law) == pytest.approx(1e-4)
    assert smallest_variance(law._replace(look_std=1.0)) == pytest.approx(1e-2)
    state, least = zeroing.unlearnt(law), math.inf
    for _ in range(2000):
        state = zeroing.zeroed(state, 0.0, False, law, False, 5.0, 0.01)
        least = min(least, state.variance)
        assert unreachable_zeroing(state, law, 1.0, 5.0) == ""
    assert least < 0.9e-2


def test_what_the_adaptation_comes_to_is_never_refused(setup: Setup) -> None:
    tuning, car = setup.settings.estimator.tuning(), setup.settings.vehicle.car()
    state: StiffnessState = initial_stiffness(tuning)
    for k in range(100_000):
        t_s = 0.02 * k
        ay = 3.0 * math.sin(0.5 * t_s)
        delta = 0.02 * math.sin(0.5 * t_s - 0.1) + 0.003 * math.sin(7.0 * t_s)
        state = adapted(state, car, 20.0, ay / 20.0, ay, delta, tuning, 0.02)
        if k % 50 == 0:
            assert unreachable_stiffness(state, tuning) == ""
    assert state.p33 < 0.01 * initial_stiffness(tuning).p33


@pytest.mark.parametrize(
    ("given", "kept"), [(21.5, 21.5), (None, None), (math.nan, None), (math.inf, None), (-40.0, -40.0)]
)
def test_the_temperature(setup: Setup, learnt: EstimatorState, given: float | None, kept: float | None) -> None:
    recall = later(setup, saved(setup, learnt, temperature=given), 11520.0)
    assert recall.temperature_degc == kept
    channels = ", ".join(IMU_CHANNELS)
    at = "" if kept is None else f" at {kept:.0f} degC"
    assert recall.in_words() == f"{channels} as learnt 3.2 h ago{at}"


@pytest.mark.parametrize("value", [1e9, -1e9, math.nan, "20", True, [20], HUGE])
def test_a_temperature_that_is_none(setup: Setup, learnt: EstimatorState, value: object) -> None:
    assert later(setup, saved(setup, learnt) | {"temperature_degc": value}, 1.0).temperature_degc is None


def test_saving_changes_nothing_and_is_plain_json(setup: Setup, learnt: EstimatorState) -> None:
    before = repr(learnt)
    body = remembered(setup, learnt, NOW_NS, 20.0, MORNING)
    assert repr(learnt) == before
    assert json.loads(json.dumps(body, allow_nan=False)) == body
    assert body["saved_ns"] == NOW_NS
    fresh = remembered(setup, initial_state(setup.settings.estimator.tuning()), NOW_NS, None, MORNING)
    json.dumps(fresh, allow_nan=False)


def test_the_configured_folder_does_not_matter(setup: Setup, learnt: EstimatorState, tmp_path: Path) -> None:
    """A configuration that was moved or renamed is still the same car."""
    shutil.copytree(setup.path.parent, tmp_path / "moved")
    moved = set_up((tmp_path / "moved" / "config.yaml").rename(tmp_path / "moved" / "other.yaml"))
    assert later(moved, saved(setup, learnt), 1.0).taken == IMU_CHANNELS


@pytest.mark.parametrize(
    ("place", "value", "why"),
    [
        pytest.param(("gyro_x", "variance"), 10**5000, "bits is too large", id="huge"),
        (("gyro_x", "variance"), [1.0], "list is not a number"),
        (("gyro_x", "variance"), DEEP, "list is not a number"),
        (("gyro_x",), [1.0] * 8, "expected the fields"),
        (("transient", "mean"), [0.0] * 3, "expected 8 numbers"),
        (("transient", "mean"), 0.0, "expected 8 numbers"),
        (("transient", "mean"), [[0.0]] * 8, "list is not a number"),
        pytest.param(("transient", "mean"), [10**5000] * 8, "bits is too large", id="huge list"),
    ],
)
def test_nasty_plain_states_are_refused(setup: Setup, place: tuple[str, ...], value: Any, why: str) -> None:
    from dsz_daemon.core.state import as_plain

    plain = as_plain(initial_state(setup.settings.estimator.tuning()))
    inner = plain
    for key in place[:-1]:
        inner = inner[key]
    inner[place[-1]] = value
    with pytest.raises(ValueError, match=why) as caught:
        from_plain(plain)
    assert len(str(caught.value)) < 300
