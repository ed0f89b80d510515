"""diagnose: what a model is with an effect less, and what of it has to go."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from test_diagnose_choices import CITY_STEER, CITY_V, TOLERANCE, T, drive

from dsz_daemon.diagnose.effects.vocabulary import INDEX
from dsz_daemon.diagnose.fitting.fit import fitted
from dsz_daemon.diagnose.fitting.gains import gained
from dsz_daemon.diagnose.residuals.comparison import all_hands, rows_of
from dsz_daemon.diagnose.selection import search as search_module
from dsz_daemon.diagnose.selection import smaller as smaller_module
from dsz_daemon.diagnose.selection import trials as trials_module
from dsz_daemon.diagnose.selection.plausible import does_nothing
from dsz_daemon.diagnose.selection.search import searched
from dsz_daemon.diagnose.selection.smaller import Grown, asked_of, plausible, without_trifles, worth_now
from dsz_daemon.diagnose.selection.trials import Step
from dsz_daemon.diagnose.shapes.unlisted import Found, as_effect
from dsz_daemon.diagnose.simulation.drive import nothing
from dsz_daemon.diagnose.verdict.answer import answered


@pytest.mark.parametrize(
    ("effects", "newest_gains", "without_gains", "is_settled"),
    [
        (("road_bank",), 9.0, 50.0, True),
        (("wheel_slip", "side_wind"), 9.0, 11.0, True),
        (("road_bank",), 11.0, 50.0, False),
        (("road_bank",), 9.0, 9.0, False),
        (("wheel_slip",), 9.0, 50.0, False),
        ((), 9.0, 50.0, False),
    ],
)
def test_beside_a_road_what_any_candidate_would_bring_is_the_models_own(
    monkeypatch: pytest.MonkeyPatch,
    effects: tuple[str, ...],
    newest_gains: float,
    without_gains: float,
    is_settled: bool,
) -> None:
    """A fit with a road is not settled: what is gained without the newest, too, is no reason to name that."""
    best, fit, without = (SimpleNamespace(effects=there) for there in (effects, (*effects, "gyro_scale"), effects))
    none: Any = None
    asked: list[str] = []

    def refitted(_: Any, __: Any, start: Any, ___: Any, newest: tuple[str], ____: Any) -> Any:
        assert start is fit
        asked.extend(newest)
        return without if newest == ("gyro_scale",) else none

    def gains(_: Any, smaller: Any, larger: Any) -> float:
        return {(id(without), id(fit)): newest_gains, (id(best), id(without)): without_gains}[id(smaller), id(larger)]

    def surely(_: Any, __: Any, start: Any, ___: Any, newest: str, *____: Any) -> Any:
        return refitted(_, __, start, ___, (newest,), ____)

    monkeypatch.setattr(smaller_module, "without", refitted)
    monkeypatch.setattr(smaller_module, "surely_without", surely)
    monkeypatch.setattr(smaller_module, "slopes_at", lambda *_: None)
    monkeypatch.setattr(smaller_module, "gained", gains)
    the_best: Any = best
    the_fit: Any = fit
    found = Grown(none, none, {}, the_best, the_fit).settled()
    assert found is (without if is_settled else None)
    # What is tried without each of its effects is, at once; where nothing is unsettled, nothing is fitted.
    on_a_road = set(effects) & {"road_bank", "side_wind"}
    # What takes longest comes first, the road or the wind.
    longest_first = [*sorted(effects, key=lambda effect: effect == "wheel_slip"), "gyro_scale"]
    assert asked == (longest_first if on_a_road else [])


def test_each_earlier_effect_is_tried_without_and_again_without_what_had_to_go(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The second explains nothing that others do not; what the third gains is what it gains without the second."""
    asked: list[tuple[str, ...]] = []

    def refitted(_: Any, __: Any, start: Any, ___: Any, less: tuple[str], ____: Any) -> Any:
        asked.append((*start.effects, *("-" + name for name in less)))
        return SimpleNamespace(
            effects=tuple(name for name in start.effects if name not in less), _replace=lambda form: less
        )

    def gains(_: Any, less: tuple[str], larger: Any) -> float:
        third, newest = (11.0, 15.0) if "second" in larger.effects else (30.0, 70.0)
        return {"first": 50.0, "second": 9.0, "third": third, "newest": newest}[less[0]]

    def surely(_: Any, __: Any, start: Any, ___: Any, newest: str, *____: Any) -> Any:
        return refitted(_, __, start, ___, (newest,), ____)

    monkeypatch.setattr(smaller_module, "without", refitted)
    monkeypatch.setattr(smaller_module, "surely_without", surely)
    monkeypatch.setattr(smaller_module, "slopes_at", lambda *_: None)
    monkeypatch.setattr(smaller_module, "gained", gains)
    monkeypatch.setattr(smaller_module, "does_nothing", lambda *_: False)
    rows: Any = SimpleNamespace(form=None)
    none: Any = None
    now: Any = SimpleNamespace(effects=("first", "second", "third", "newest"))
    before: Any = SimpleNamespace(effects=("first", "second", "third"))
    found = {"newest": 15.0}
    best = Grown(none, rows, {}, before, now).without_idle(found)
    assert best.effects == ("first", "third", "newest")
    # The newest has driven the second out: it has gained what both did.
    assert found == {"first": 50.0, "second": 9.0, "third": 30.0, "newest": 70.0}
    assert asked == [
        *((*now.effects, "-" + name) for name in ("first", "second", "third")),
        ("first", "third", "newest", "-third"),
        ("first", "third", "newest", "-newest"),
    ]


@pytest.mark.parametrize(("by_rows_form", "by_its_own"), [(40.0, 20.0), (20.0, 40.0)])
def test_what_stays_surely_does_so_by_either_form(
    monkeypatch: pytest.MonkeyPatch, by_rows_form: float, by_its_own: float
) -> None:
    """What an effect is worth is asked twice later: by the rows' form, and by what the smaller model's may be."""
    worths: list[float] = []

    def gains(_: Any, rest: Any, __: Any) -> float:
        return by_rows_form if rest.form == "the rows'" else by_its_own

    def surely(*given: Any) -> Any:
        rest = SimpleNamespace(form="its own", _replace=lambda form: SimpleNamespace(form=form))
        worths.append(given[6](rest))
        assert given[5] == "the slopes"
        return rest

    monkeypatch.setattr(smaller_module, "surely_without", surely)
    monkeypatch.setattr(smaller_module, "slopes_at", lambda *_: "the slopes")
    monkeypatch.setattr(smaller_module, "gained", gains)
    monkeypatch.setattr(smaller_module, "does_nothing", lambda *_: False)
    rows: Any = SimpleNamespace(form="the rows'")
    none: Any = None
    now: Any = SimpleNamespace(effects=("first", "newest"))
    before: Any = SimpleNamespace(effects=("first",))
    Grown(none, rows, {}, before, now).without_idle({})
    assert worths == [20.0]


@pytest.mark.parametrize("works", [["one"], ["one", "other"]])
def test_one_work_alone_has_all_hands_and_several_have_one_each(works: list[str]) -> None:
    def each(task: Any, items: Any) -> Any:
        return map(task, items)

    used: list[Any] = []

    def task(work: str, hands: Any) -> str:
        used.append(hands)
        return work.upper()

    assert all_hands(task, works, each) == [work.upper() for work in works]
    assert used == ([each] if len(works) == 1 else [map, map])
    assert all_hands(task, [], each) == []


def test_what_came_early_has_to_gain_its_share_of_all_in_the_end(monkeypatch: pytest.MonkeyPatch) -> None:
    one = drive({"gyro_scale.z": 0.05, "wheel_radius.rl": -0.01}, CITY_V, CITY_STEER)
    rows = rows_of(one)
    both = fitted(one, rows, nothing(), ("gyro_scale", "wheel_radius"), TOLERANCE)

    def kept(gain: float) -> tuple[str, ...]:
        gains = {"gyro_scale": gain, "wheel_radius": 1000.0}
        return without_trifles(one, rows, both, TOLERANCE, gains, map).effects

    monkeypatch.setattr(smaller_module, "is_beyond_form", lambda *_: False)
    assert kept(16.0) == both.effects
    assert kept(14.0) == ("wheel_radius",)
    # But for what puts right what was far off without it.
    monkeypatch.setattr(smaller_module, "is_beyond_form", lambda _, smaller, __: smaller.effects == ("wheel_radius",))
    assert kept(14.0) == both.effects


@pytest.mark.parametrize(
    ("size", "claimed", "share", "beyond", "is_in"),
    [
        # A hundred or so are less than a half of 654, which it would have to gain in the end; and more than a fiftieth.
        (0.01, 1e6, 0.5, False, False),
        (0.01, 1e6, 0.5, True, True),
        (0.01, 1e6, 0.02, False, True),
        # What was gained by another yardstick, and by the names' is not; and the other way round.
        (0.0, 1e6, 0.02, False, False),
        (0.01, 9.0, 0.0, False, False),
    ],
)
def test_a_shape_is_taken_up_for_what_it_gains_as_names_do_and_not_for_a_trifle(
    monkeypatch: pytest.MonkeyPatch, size: float, claimed: float, share: float, beyond: bool, is_in: bool
) -> None:
    course = np.sin(2.9 * T)

    def wavy(one: Any) -> None:
        one.measured[:, 5] += size * course

    one = drive({"gyro_scale.z": 0.05}, CITY_V, CITY_STEER, change=wavy)
    effect = as_effect("accel_z", "sine", course, "m/s2", 0.01)

    def shape(_drive: Any, _rows: Any, best: Any, *_: Any, **__: Any) -> list[Found]:
        if "gyro_scale" not in best.effects or effect.name in best.effects:
            return []
        return [Found(effect, "accel_z", "k*sine", 0.1, claimed, 0.005, 1e-5)]

    monkeypatch.setattr(search_module, "likeliest_shapes", shape)
    monkeypatch.setattr(smaller_module, "_SHARE_OF_ALL", share)
    for room in (search_module, trials_module, smaller_module):
        monkeypatch.setattr(room, "is_beyond_form", lambda *_: beyond)
    said: list[str] = []
    found = searched(one, rows_of(one), TOLERANCE, said.append)
    assert 400.0 < found.gains["gyro_scale"] < 1000.0
    assert any("shape without a name" in words for words in said) is is_in
    assert (effect.name in found.best.effects) is is_in
    assert [shape.effect.name for shape in found.shapes] == [effect.name] * is_in
    assert len(found.nominal.x) == len(found.best.x)
    if is_in:
        assert 20.0 < found.gains[effect.name] < 300.0


def test_a_shape_that_seems_to_gain_more_than_a_name_and_does_not_comes_after_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Offered from the start on, for a thousand times what it gains."""
    course = np.sin(2.9 * T)

    def wavy(one: Any) -> None:
        one.measured[:, 5] += 0.01 * course

    one = drive({"gyro_scale.z": 0.05}, CITY_V, CITY_STEER, change=wavy)
    effect = as_effect("accel_z", "sine", course, "m/s2", 0.01)

    def shape(_drive: Any, _rows: Any, best: Any, *_: Any, **__: Any) -> list[Found]:
        return [] if effect.name in best.effects else [Found(effect, "accel_z", "k*sine", 0.1, 1e6, 0.005, 1e-5)]

    monkeypatch.setattr(search_module, "likeliest_shapes", shape)
    found = searched(one, rows_of(one), TOLERANCE)
    assert found.best.effects == ("gyro_scale", effect.name)
    assert found.gains["gyro_scale"] > found.gains[effect.name] > 20.0


def test_beside_a_limit_of_grip_more_is_asked_of_what_a_tyres_own_curve_may_be() -> None:
    one = drive({}, CITY_V, CITY_STEER)
    gains = {"tyre_saturation": 700.0, "steering_compliance": 20.0, "gyro_scale": 80.0}

    def asked(effect: str, *gone: str) -> float:
        return asked_of(one, effect, {name: gain for name, gain in gains.items() if name not in gone})

    for car in ("steering_compliance", "steering_ratio", "accel_y: k*ay^3"):
        assert asked(car) == pytest.approx(56.0)
        assert asked(car, "tyre_saturation") == pytest.approx(1.5)
    # Sensors have no grip.
    for other in ("gyro_scale", "tyre_saturation", "road_bank"):
        assert asked(other) == pytest.approx(12.0)
    # A second limit beside the first is the same curve, unless it does much; not beside itself.
    assert asked("low_friction") == pytest.approx(140.0)
    gains["low_friction"] = 1000.0
    assert asked("steering_ratio") == pytest.approx(80.0)
    assert asked("tyre_saturation") == pytest.approx(200.0)
    assert asked("low_friction") == pytest.approx(140.0)


def test_what_came_before_a_limit_of_grip_may_be_its_curve_as_well(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(smaller_module, "is_beyond_form", lambda *_: False)
    one = drive({"steering_ratio.scale": 0.05}, CITY_V, CITY_STEER)
    rows, start = rows_of(one), nothing()
    start[one.vocabulary.columns_of("tyre_saturation")[0]] = 0.5
    both = fitted(one, rows, start, ("steering_ratio", "tyre_saturation"), TOLERANCE)
    for gain, effects in ((81.0, both.effects), (79.0, ("tyre_saturation",))):
        gains = {"steering_ratio": gain, "tyre_saturation": 1000.0}
        assert without_trifles(one, rows, both, TOLERANCE, gains, map).effects == effects


def test_of_two_that_came_at_once_the_one_that_a_road_leaves_is_told_with_what_it_gains(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A slip and a magnet put a channel right together; beside a hill the slip does alone, and had no gain yet."""
    one = drive({"gyro_scale.z": 0.05}, CITY_V, CITY_STEER)
    rows = rows_of(one)
    both = fitted(one, rows, nothing(), ("gyro_scale", "accel_scale"), TOLERANCE)
    alone = fitted(one, rows, nothing(), ("gyro_scale",), TOLERANCE)
    pairs, settled = [[Step("accel_scale", 100.0, both)]], [alone]
    monkeypatch.setattr(search_module, "starts_of", lambda *_: [])
    monkeypatch.setattr(search_module, "likeliest_shapes", lambda *_, **__: [])
    monkeypatch.setattr(search_module, "two_at_once", lambda *_: pairs.pop() if pairs else [])
    monkeypatch.setattr(smaller_module.Grown, "settled", lambda _: settled.pop() if settled else None)
    found = searched(one, rows, TOLERANCE)
    assert found.best.effects == ("gyro_scale",)
    gain = gained(one, found.nominal, alone)
    assert gain > 100.0
    assert found.gains == {"gyro_scale": pytest.approx(gain)}
    assert [(step.effect, step.gain) for step in found.rivals["gyro_scale"]] == [("gyro_scale", pytest.approx(gain))]
    assert [cause.effect for cause in answered(found).causes] == ["gyro_scale"]


def test_what_comes_and_has_to_go_again_and_again_ends_a_search(monkeypatch: pytest.MonkeyPatch) -> None:
    """A swinging bracket was a scale, which was none beside the next, which was none beside it: twelve rounds of it."""
    one = drive({"gyro_scale.z": 0.05}, CITY_V, CITY_STEER)
    rounds = []

    def goes(drive: Any, rows: Any, before: Any, best: Any, *_: Any) -> tuple[Any, set[str]]:
        rounds.append(best.effects)
        return before._replace(), {"another"}

    monkeypatch.setattr(search_module, "plausible", goes)
    found = searched(one, rows_of(one), TOLERANCE)
    assert found.best.effects == ()
    # Once with nothing refused, and twice with the other.
    assert rounds == 3 * [("gyro_scale",)]


def late(**more: float) -> tuple[Any, Any, Any]:
    """A drive whose IMU is late, its rows, and the model with that, and with what else is there."""
    one = drive({"imu_delay.delay_s": 0.02}, CITY_V, CITY_STEER)
    rows = rows_of(one)
    x = nothing()
    for name, value in more.items():
        x[INDEX[name.replace("__", ".")]] = value
    fit = fitted(one, rows, x, ("imu_delay",), TOLERANCE)
    return one, rows, fit


def test_what_is_not_there_gains_nothing_whatever_slopes_promise(monkeypatch: pytest.MonkeyPatch) -> None:
    """Down a slope that is none beyond the first step a fit goes nowhere; held-out blocks are judged by slopes."""
    one, rows, fit = late()
    assert not does_nothing(one, fit, "imu_delay")
    for effect, beside in (("tyre_relaxation", {}), ("imu_clock", {"imu_clock.late_s": 0.01}), ("imu_delay", {})):
        x = nothing()
        for name, value in beside.items():
            x[INDEX[name]] = value
        assert does_nothing(one, fit._replace(x=x), effect)
    # A road's profile is no number of its own.
    assert not does_nothing(one, fit._replace(x=nothing()), "road_bank")
    still = fit._replace(x=nothing(), effects=("tyre_relaxation",))
    monkeypatch.setattr(trials_module, "fitted", lambda *_, **__: still)
    monkeypatch.setattr(trials_module, "gained", lambda *_, **__: 11.5)
    monkeypatch.setattr(trials_module, "is_implausible", lambda *_: False)
    known: Any = None
    trial = trials_module.Trial(one, rows, fit, TOLERANCE, known)
    assert trial.fit((("tyre_relaxation",), nothing())).gain == -np.inf
    still.x[INDEX["tyre_relaxation.relaxation_length_m"]] = 0.1
    assert trial.fit((("tyre_relaxation",), nothing())).gain == 11.5


def test_what_does_nothing_beside_the_newest_goes(monkeypatch: pytest.MonkeyPatch) -> None:
    one, rows, fit = late()
    monkeypatch.setattr(smaller_module, "gained", lambda *_: 30.0)
    for delay_s, stays in ((0.0, False), (0.02, True)):
        x = fit.x.copy()
        x[INDEX["imu_delay.delay_s"]], x[INDEX["imu_clock.per_s"]] = delay_s, 1e-4
        now = fit._replace(x=x, effects=("imu_delay", "imu_clock"))
        gains = {"imu_delay": 14.0, "imu_clock": 30.0}
        best = Grown(one, rows, TOLERANCE, fit, now).without_idle(gains)
        assert ("imu_delay" in best.effects) is stays
        assert gains["imu_delay"] == (30.0 if stays else 0.0)


@pytest.mark.parametrize(("by_the_new", "by_the_old", "stays"), [(-7.0, -2.0, False), (-2.0, -7.0, True)])
def test_what_drives_another_out_has_to_explain_more_than_it(
    monkeypatch: pytest.MonkeyPatch, by_the_new: float, by_the_old: float, stays: bool
) -> None:
    one, rows, before = late()
    clock = before._replace(effects=("imu_clock",))
    monkeypatch.setattr(smaller_module, "gained", lambda _, __, larger: by_the_new if larger is clock else by_the_old)
    monkeypatch.setattr(smaller_module, "is_implausible", lambda *_: False)
    best, refused = plausible(one, rows, before, clock, TOLERANCE, map)
    assert (best.effects, refused) == ((("imu_clock",), set()) if stays else (("imu_delay",), {"imu_clock"}))
    # Beside what was there before nothing is asked.
    both = before._replace(effects=("imu_delay", "imu_clock"))
    assert plausible(one, rows, before, both, TOLERANCE, map)[0].effects == both.effects


def test_with_a_shapes_help_a_name_gains_no_more_than_it_did(monkeypatch: pytest.MonkeyPatch) -> None:
    """What stays beside a shape has gained what it did, or what it gains now if that is less; what goes, nothing."""
    now: Any = SimpleNamespace(effects=("gyro_scale", "wheel_radius", "imu_delay", "gyro_z: k*vx"))
    rest: Any = SimpleNamespace(effects=("gyro_scale", "wheel_radius", "gyro_z: k*vx"))

    def without_idle(_: Grown, gains: dict[str, float]) -> Any:
        gains |= {"gyro_scale": 900.0, "wheel_radius": 60.0, "imu_delay": 2.0, "gyro_z: k*vx": 300.0}
        return rest

    monkeypatch.setattr(Grown, "without_idle", without_idle)
    before = {"gyro_scale": 400.0, "wheel_radius": 80.0, "imu_delay": 50.0, "gyro_z: k*vx": 200.0}
    none: Any = None
    best, gains = Grown(none, none, {}, SimpleNamespace(effects=()), now).what_stays(before)  # type: ignore[arg-type]
    assert best is rest
    assert gains == {"gyro_scale": 400.0, "wheel_radius": 60.0, "gyro_z: k*vx": 200.0}


@pytest.mark.parametrize(
    ("came", "expected"),
    [
        # The second gave its place: the third made up for what was wrong with it, and gains little beside the new.
        (("gyro_scale", "imu_misalignment", "gyro_g_sensitivity"), {"gyro_scale": 500.0, "gyro_g_sensitivity": 3.0}),
        # What gains more beside the new than it did has gained what it did.
        (("imu_misalignment", "gyro_scale", "gyro_g_sensitivity"), {"gyro_scale": 500.0, "gyro_g_sensitivity": 3.0}),
        # All that came before is as it was, and so is all where nothing gave its place.
        (("gyro_scale", "gyro_g_sensitivity", "imu_misalignment"), {"gyro_scale": 500.0, "gyro_g_sensitivity": 200.0}),
        (("gyro_scale", "accel_cross_axis", "gyro_g_sensitivity"), {"gyro_scale": 500.0, "gyro_g_sensitivity": 200.0}),
    ],
)
def test_what_came_after_what_gave_its_place_is_worth_what_it_is_beside_the_other(
    monkeypatch: pytest.MonkeyPatch, came: tuple[str, ...], expected: dict[str, float]
) -> None:
    worth = {"gyro_scale": 700.0, "gyro_g_sensitivity": 3.0, "accel_cross_axis": 0.0}
    monkeypatch.setattr(smaller_module, "unfelt_roads", lambda _: [])
    monkeypatch.setattr(smaller_module, "without", lambda _, __, ___, ____, effects, _____: effects)
    monkeypatch.setattr(smaller_module, "gained", lambda _, rest, __: worth[rest[0]])
    effects = ("gyro_scale", "accel_cross_axis", "gyro_g_sensitivity", "accel_x: k*vx")
    best: Any = SimpleNamespace(effects=effects, felt=SimpleNamespace(is_anew=False))
    gains = {"gyro_scale": 500.0, "accel_cross_axis": 900.0, "gyro_g_sensitivity": 200.0, "accel_x: k*vx": 80.0}
    none: Any = None
    now = worth_now(none, none, best, TOLERANCE, gains, came, map)
    assert now == gains | expected
