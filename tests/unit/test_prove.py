"""The proof: what is drawn, how it is sealed, how answers are scored."""

from __future__ import annotations

import gzip
import json
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dsz_daemon.diagnose.effects.shape_names import NO_SHAPE
from dsz_daemon.edge.samples_file import write_columns
from dsz_daemon.errors import ConfigError, InputError
from dsz_daemon.prove.missed import missed
from dsz_daemon.prove.mix import MILD, OWN, as_truth, trials
from dsz_daemon.prove.page import is_failure, page, results_lines
from dsz_daemon.prove.prove import _claim, _sealed_trial, _truth, prove
from dsz_daemon.prove.recordings import PACKED
from dsz_daemon.prove.score import is_first, scored
from dsz_daemon.prove.seal import opened, sealed
from dsz_daemon.prove.shorter import begin, chosen, name_of
from dsz_daemon.prove.sizes import at_size
from dsz_daemon.prove.summary import summary, wilson
from dsz_daemon.prove.unlisted import UNLISTED, with_unlisted
from dsz_daemon.prove.ways import car, way
from dsz_daemon.sim.effects import EFFECTS, faults
from dsz_daemon.sim.journey import programme_along


def test_the_mix_is_drawn_by_the_seed_and_in_no_order() -> None:
    drawn = trials(5, 400)
    assert drawn == trials(5, 400)
    assert drawn != trials(6, 400)
    groups = Counter(trial.group for trial in drawn)
    assert groups["null"] == 120
    assert groups["unlisted"] >= 0.15 * 400
    assert sum(groups.values()) == 400
    first = Counter(trial.group for trial in drawn[:200])
    assert all(abs(first[group] - count / 2) < 3.0 * count**0.5 for group, count in groups.items())
    assert {trial.size for trial in drawn if trial.group == "single"} == {1.0, 0.3, 0.1}
    assert {trial.car for trial in drawn if trial.group == "single"} == {"own", "third_party"}
    # Every own car that has something has several others mildly; of a third party's nothing is mild.
    assert {len(trial.mild) for trial in drawn if trial.car == "own" and trial.group == "single"} == {4}
    assert {trial.mild for trial in drawn if trial.car == "third_party"} == {()}
    # What is drawn can be simulated.
    assert not [fault for trial in drawn for fault in faults([*trial.effects, *trial.mild])]


def test_what_is_drawn_can_be_known() -> None:
    """No limit that no drive gets to, no stiffness within its tolerance, no load that undoes a soft steering."""
    drawn = trials(5, 1000)
    sizes: dict[str, set[float]] = {}
    for trial in drawn:
        if trial.group == "single":
            sizes.setdefault(trial.effects[0].name, set()).add(trial.size)
    assert {name for name, there in sizes.items() if there == {1.0}} == {
        "sensor_saturation", "cornering_stiffness", "axis_fault",
    }  # fmt: skip
    loads = [choice for trial in drawn if trial.group == "alias_pair" for choice in trial.effects]
    shifts = {float(choice.given["cg_shift_m"]) for choice in loads if choice.name == "mass_loading"}
    assert shifts == {0.15}
    alone = [choice for trial in drawn if trial.group == "single" for choice in trial.effects]
    assert {float(c.given["cg_shift_m"]) for c in alone if c.name == "mass_loading"} <= {-0.15, -0.045, -0.015}


def test_of_nulls_half_have_another_stiffness_and_nothing_else() -> None:
    nulls = [trial for trial in trials(5, 1000) if trial.group == "null"]
    assert {trial.effects + trial.unlisted + trial.mild for trial in nulls} == {()}
    assert {trial.car for trial in nulls} == {OWN}
    off = [trial for trial in nulls if trial.stiffness != (1.0, 1.0)]
    assert 0.4 < len(off) / len(nulls) < 0.6
    assert all(0.9 < share < 1.1 for trial in off for share in trial.stiffness)
    assert 0.4 < sum(trial.flicker for trial in nulls) / len(nulls) < 0.6


@pytest.mark.parametrize("name", sorted(EFFECTS))
def test_smaller_is_nearer_to_nothing(name: str) -> None:
    plain, small = at_size(name, 1.0), at_size(name, 0.1)
    if name == "axis_fault":
        assert small is None
        return
    assert plain is not None
    assert small is not None
    for key, value in plain.given.items():
        if key in {"cutoff_hz", "accel_limit_mps2", "friction_coefficient"}:
            assert float(small.given[key]) > 3.0 * float(value)
            continue
        neutral = 1.0 if name in {"wheel_radius", "steering_ratio", "cornering_stiffness"} else 0.0
        assert float(small.given[key]) - neutral == pytest.approx(0.1 * (float(value) - neutral))


@pytest.mark.parametrize("kind", ["city", "highway"])
@pytest.mark.parametrize("may_stand", [True, False])
def test_ways_can_be_driven_and_last(kind: str, may_stand: bool) -> None:
    for seed in range(30):
        found = way(np.random.default_rng(seed), kind, 150.0, may_stand)
        programme = programme_along(found.legs, found.stand_s, found.start_mps)
        time_s = np.arange(0.0, 150.0, 0.1)
        speed, _ = programme.wanted(time_s)
        assert programme.duration_s > 150.0
        # A car without tyres for standing keeps rolling.
        assert may_stand or speed.min() > 3.0
        assert speed.max() < 36.0


def test_cars_understeer() -> None:
    for seed in range(50):
        one = car(np.random.default_rng(seed))
        front = one.cg_to_rear_axle_m / one.front_cornering_stiffness_n_per_rad
        assert front > one.cg_to_front_axle_m / one.rear_cornering_stiffness_n_per_rad


@pytest.mark.parametrize("name", sorted(UNLISTED))
def test_what_has_no_name_is_in_its_column_alone(name: str) -> None:
    rng = np.random.default_rng(3)
    names = ["speed_mps", "gyro_z_radps", "accel_x_mps2", "accel_y_mps2", "accel_z_mps2", "wheel_speed_rl_mps",
             "steering_wheel_angle_rad"]  # fmt: skip
    columns = {key: 10.0 + rng.normal(size=50) for key in names}
    changed = with_unlisted(columns, name, 1.0, 2.0)
    assert [key for key in columns if not np.array_equal(columns[key], changed[key])] == [UNLISTED[name].column]
    half = with_unlisted(columns, name, 0.5, 2.0)[UNLISTED[name].column] - columns[UNLISTED[name].column]
    whole = changed[UNLISTED[name].column] - columns[UNLISTED[name].column]
    assert half == pytest.approx(0.5 * whole)


def test_a_seal_that_was_broken_is_seen(tmp_path: Path) -> None:
    truth = {"number": 1, "effects": [{"effect": "gyro_scale"}]}
    published = sealed(truth, tmp_path / "1.json")
    assert opened(tmp_path / "1.json", published) == truth
    # The same truth has another hash each time: nobody can try truths until one fits.
    assert sealed(truth, tmp_path / "2.json") != published
    text = (tmp_path / "1.json").read_text()
    (tmp_path / "1.json").write_text(text.replace("gyro_scale", "accel_scale"))
    with pytest.raises(InputError, match="not what was sealed"):
        opened(tmp_path / "1.json", published)


def test_a_folder_holds_one_proof(tmp_path: Path) -> None:
    _claim(tmp_path, {"seed": 1, "trials": 40})
    _claim(tmp_path, {"seed": 1, "trials": 40})
    with pytest.raises(ConfigError, match="holds another proof"):
        _claim(tmp_path, {"seed": 2, "trials": 40})


def test_a_trial_that_is_sealed_is_not_made_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    trial = trials(5, 10)[0]
    path = _truth(tmp_path, trial)
    published = sealed({"number": trial.number}, path)
    monkeypatch.setattr("dsz_daemon.prove.prove.made", lambda *_: pytest.fail("made again"))
    assert _sealed_trial((trial, tmp_path)) == (f"{trial.number:05d}", published)
    assert [one.name for one in path.parent.iterdir()] == [path.name]


def test_a_wrong_seed_is_said_before_anything_is_made(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="-1 is negative"):
        prove(tmp_path / "proof", -1, 10)
    assert not (tmp_path / "proof").exists()


def test_a_bar_holds_only_where_its_interval_does(tmp_path: Path) -> None:
    """None of 36 may be one in ten; none of 300 is surely less than two in a hundred (1.26 %)."""
    one = answered(tmp_path, [], [], group="null")
    for count, holds in ((36, "**no**"), (300, "yes")):
        lines = {line[0]: line for line in results_lines(summary([one] * count))}
        assert lines["false alarms on nulls"][1].startswith(f"0 of {count}")
        assert lines["false alarms on nulls"][2:] == ("at most 0.01, surely at most 0.02", holds)


def test_a_shape_beside_the_right_name_is_one_too_many(tmp_path: Path) -> None:
    planted = [{"effect": "gyro_scale", "parameters": {}}]
    shape = {"channel": "accel_x", "shape": "k*vx^2"}
    one = answered(tmp_path, [cause("gyro_scale")], planted, shapes=[shape], car="own")
    assert summary([one])["shapes_too_many"]["hits"] == 1
    assert summary([one | {"car": "third_party"}])["shapes_too_many"]["of"] == 0


def test_a_car_that_shakes_itself_is_counted_by_itself(tmp_path: Path) -> None:
    planted = [{"effect": "gyro_scale", "parameters": {}}]
    right = answered(tmp_path, [cause("gyro_scale")], planted, car="third_party")
    wrong = answered(tmp_path, [cause("accel_scale")], planted, car="third_party", group="as_published")
    found = summary([right, right | {"group": "as_published"}, wrong])
    assert (found["trials"], found["singles_1"]["of"], found["false_extras"]["hits"]) == (1, 1, 0)
    assert [found["as_published"][key] for key in ("hits", "of")] == [1, 2]
    assert [found["as_published_extras"][key] for key in ("hits", "of")] == [1, 2]


def test_wilsons_intervals() -> None:
    """Hand values: none of 300 leaves up to 1.26 %; of 81 of 263 the interval is that of Newcombe 1998, method 3."""
    assert wilson(0, 300) == (pytest.approx(0.0, abs=1e-12), pytest.approx(0.01264, abs=1e-5))
    assert wilson(81, 263) == (pytest.approx(0.2553, abs=1e-4), pytest.approx(0.3662, abs=1e-4))
    assert wilson(0, 0) == (0.0, 1.0)


def cause(effect: str, alike: tuple[str, ...] = (), others: tuple[tuple[str, float], ...] = (), **values: Any) -> Any:
    return {
        "effect": effect,
        "probability": 0.9,
        "parameters": {key: {"value": value, "std": std} for key, (value, std) in values.items()},
        "indistinguishable_from": list(alike),
        "alternatives": [{"effect": name, "probability": odds} for name, odds in others],
    }


def answered(folder: Path, causes: list[Any], planted: list[Any], **truth: Any) -> dict[str, Any]:
    found = {
        "verdict": "explained" if causes else "consistent",
        "causes": causes,
        "parameter_errors": truth.pop("errors", []),
        "unlisted": truth.pop("shapes", []),
        "fit": truth.pop("fit", {}),
        "level": truth.pop("level", {}),
        "could_not_test": truth.pop("could_not_test", []),
    }
    (folder / "diagnosis.json").write_text(json.dumps(found))
    zeros = np.zeros(100)
    profile = np.linspace(0.0, 0.1, 100)
    courses = {"time_s": np.arange(100.0), "road_grade_up_rad": profile, "road_bank_rad": zeros}
    for channel in ("wheel_other_left", "gyro_z", "accel_x", "accel_y"):
        courses |= {f"{channel}_{what}": 10.0 + zeros for what in ("measured", "nominal", "fitted")}
    write_columns(courses, folder / "fit.parquet")
    driven = {"time_s": np.arange(100.0), "speed_mps": zeros + 10.0, "road_grade_up_rad": 2.0 * profile}
    write_columns(driven, folder / "1.parquet")
    whole = as_truth(trials(1, 10)[0]) | {"effects": planted, "group": "single", "unlisted": [], "mild": []}
    whole |= {"by_construction": [], "stiffness": (1.0, 1.0)} | truth
    return scored(whole, folder, folder / "1.parquet")


def test_the_planted_effect_first_is_right(tmp_path: Path) -> None:
    planted = [{"effect": "gyro_scale", "parameters": {"x": 0.05}}]
    one = answered(tmp_path, [cause("gyro_scale", x=(0.06, 0.004)), cause("wheel_slip")], planted)
    assert (one["first"], one["all_named"], one["extra"]) == (True, True, ["wheel_slip"])
    assert one["off"] == [pytest.approx(2.5)]
    assert is_failure(one)
    one = answered(tmp_path, [cause("wheel_slip"), cause("gyro_scale")], planted)
    assert (one["first"], one["all_named"]) == (False, True)
    one = answered(tmp_path, [cause("gyro_scale")], planted)
    assert not is_failure(one)


def test_what_a_car_always_has_is_no_extra_and_comes_before_nothing(tmp_path: Path) -> None:
    planted = [{"effect": "imu_delay", "parameters": {}}]
    causes = [cause("suspension_roll"), cause("imu_delay")]
    one = answered(tmp_path, causes, planted, by_construction=["suspension_roll"])
    assert (one["first"], one["extra"]) == (True, [])
    one = answered(tmp_path, causes, planted, mild=[{"effect": "suspension_roll", "parameters": {}}])
    assert (one["first"], one["extra"]) == (True, [])


def test_an_alias_is_not_wrong_and_not_right(tmp_path: Path) -> None:
    planted = [{"effect": "imu_delay", "parameters": {}}]
    one = answered(tmp_path, [cause("sensor_bandwidth", ("imu_delay",), (("imu_delay", 0.3),))], planted)
    assert (one["first"], one["first_or_alias"], one["extra"]) == (False, True, [])
    # Of 0.9 for the pair of them 0.3 is its part.
    assert one["probability"] == [pytest.approx(0.27)]
    assert one["probability_or_alias"] == [pytest.approx(0.9)]
    one = answered(tmp_path, [cause("imu_delay", (), (("sensor_bandwidth", 0.2),))], planted)
    # 0.9 is stated of the cause, which is 0.8 of what there may be.
    assert one["probability"] == [pytest.approx(0.9)]


def test_another_effects_alias_group_does_not_help(tmp_path: Path) -> None:
    planted = [{"effect": "imu_delay", "parameters": {}}]
    one = answered(tmp_path, [cause("gyro_scale", ("accel_scale",))], planted)
    assert (one["first_or_alias"], one["all_or_alias"], one["extra"]) == (False, False, ["gyro_scale"])
    assert one["probability"] == one["probability_or_alias"] == [0.0]


def test_a_slippery_stretchs_moments_are_scored(tmp_path: Path) -> None:
    planted = [{"effect": "low_friction", "parameters": {"start_s": 30.0, "end_s": 70.0}}]
    said = cause("low_friction", start_s=(32.0, None), end_s=(69.0, None))
    one = answered(tmp_path, [said], planted)
    assert one["moments_off_s"] == (pytest.approx(2.0), pytest.approx(1.0))
    assert one["overlap"] == pytest.approx(37.0 / 40.0)
    assert answered(tmp_path, [cause("gyro_scale")], planted)["moments_off_s"] is None
    found = summary([one, one | {"moments_off_s": (4.0, 1.0)}])
    assert (found["begins_off_s"], found["ends_off_s"]) == (pytest.approx(3.0), pytest.approx(1.0))


def test_of_a_beginning_alone_it_is_scored_whether_it_is_right(tmp_path: Path) -> None:
    planted = [{"effect": "imu_delay", "parameters": {}}]
    answered(tmp_path, [cause("suspension_roll"), cause("imu_delay")], planted)
    truth = {"effects": planted, "mild": [], "by_construction": ["suspension_roll"], "stiffness": (1.0, 1.0)}
    assert is_first(truth, tmp_path)
    assert not is_first(truth | {"by_construction": []}, tmp_path)
    assert not is_first(truth, tmp_path / "nowhere")
    answered(tmp_path, [], planted, errors=[])
    assert not is_first(truth, tmp_path)


def test_lengths_are_counted_of_the_trials_of_which_beginnings_were_judged(tmp_path: Path) -> None:
    good = answered(tmp_path, [cause("gyro_scale")], [{"effect": "gyro_scale", "parameters": {}}])
    right = good | {"first_of": {"30": False, "100": True}}
    found = summary([right, right | {"first": False}, right | {"first_of": {}}])["lengths"]
    assert [(one["seconds"], one["hits"], one["of"]) for one in found] == [(30.0, 0, 2), (100.0, 2, 2), (150.0, 1, 2)]
    assert summary([good])["lengths"] == []
    protocol = {"trials": 2, "seed": 1, "version": "0", "judge": "0" * 64}
    written = page({"trials": [right], "protocol": protocol, "summary": summary([right])})
    assert "| 30 s | 0 of 1 = 0.000 (0.000 to 0.793) |" in written
    assert "| 150 s | 1 of 1 = 1.000 (0.207 to 1.000) |" in written
    # Nothing was said for another; what was, is told.
    assert "## One for another\n\nNone." in written
    other = right | {"planted": ["imu_delay"], "foremost": "sensor_bandwidth"}
    written = page({"trials": [other], "protocol": protocol, "summary": summary([other])})
    assert "| imu_delay | sensor_bandwidth | 1 |" in written


def test_the_beginning_of_a_recording_has_its_first_frames_and_its_configuration(tmp_path: Path) -> None:
    whole, there = tmp_path / "whole", tmp_path / "there"
    whole.mkdir()
    (whole / "config.yaml").write_text("car: {}\n")
    lines = [f"({1000.0 + 0.5 * k:.6f}) can0 123#00\n" for k in range(100)]
    with gzip.open(whole / PACKED, "wt") as file:
        file.writelines(lines)
    begin(whole, 20.0, there)
    with gzip.open(there / PACKED, "rt") as file:
        assert file.readlines() == lines[:41]
    assert (there / "config.yaml").read_text() == "car: {}\n"
    assert sorted(path.name for path in there.iterdir()) == ["config.yaml", PACKED]
    # What is there is left as it is.
    begin(whole, 30.0, there)
    with gzip.open(there / PACKED, "rt") as file:
        assert len(file.readlines()) == 41


def test_beginnings_are_judged_of_the_first_plain_singles() -> None:
    drawn = trials(3, 600)
    found = chosen(drawn)
    assert len(found) == 60
    assert {(trial.group, trial.size) for trial in found} == {("single", 1.0)}
    assert found == [trial for trial in drawn if (trial.group, trial.size) == ("single", 1.0)][:60]
    assert name_of(found[0], 30.0) == f"{found[0].number:05d}-030"


def test_a_null_alarms_by_a_name_or_by_its_verdict_and_not_by_a_stiffness_that_is_off(tmp_path: Path) -> None:
    stiff = {"parameter": "front_cornering_stiffness_n_per_rad", "configured": 1.0, "fitted": 0.95, "std": 0.01}
    assert not answered(tmp_path, [], [], group="null")["alarm"]
    assert answered(tmp_path, [cause("wheel_slip")], [], group="null")["alarm"]
    assert not answered(tmp_path, [], [], group="null", errors=[stiff], stiffness=(0.95, 1.0))["alarm"]
    assert answered(tmp_path, [], [], group="null", errors=[stiff])["alarm"]


def test_profiles_and_places_and_what_is_regained(tmp_path: Path) -> None:
    grade = [{"effect": "road_grade", "parameters": {"rms_rad": 0.03}}]
    fit = {"accel_x": {"held_out": {"before": 11.0, "after": 2.0}, "noise_floor": 1.0}}
    one = answered(tmp_path, [cause("road_grade")], grade, fit=fit)
    assert one["profile_rad"] == pytest.approx(float(np.std(np.linspace(0.0, 0.1, 100))))
    assert one["regained"] == pytest.approx(1.0 - 3.0 / 120.0)
    ice = [{"effect": "low_friction", "parameters": {"start_s": 40.0, "end_s": 80.0}}]
    one = answered(tmp_path, [cause("low_friction", start_s=(50.0, 1.0), end_s=(90.0, 1.0))], ice)
    assert one["overlap"] == pytest.approx(30.0 / 50.0)
    # Moments are told by their overlap.
    assert one["off"] == []


def test_what_has_no_name_is_found_in_its_channel(tmp_path: Path) -> None:
    nameless = [{"name": "vibration", "channel": "accel_x"}]
    shape = {"channel": "accel_x", "shape": "k*vx^2"}
    assert answered(tmp_path, [], [], unlisted=nameless, shapes=[shape])["unlisted_found"]
    assert not answered(tmp_path, [], [], unlisted=nameless, shapes=[shape | {"channel": "accel_y"}])["unlisted_found"]
    assert not answered(tmp_path, [], [])["unlisted_found"]
    # That a channel is off is no shape, neither of it nor too many.
    formless = shape | {"shape": NO_SHAPE}
    one = answered(tmp_path, [], [], unlisted=nameless, shapes=[formless])
    assert not one["unlisted_found"]
    assert one["shapes"] == []


def test_a_failure_has_a_reason(tmp_path: Path) -> None:
    delay = [{"effect": "imu_delay", "parameters": {}}]

    def why(causes: list[dict[str, Any]], **truth: Any) -> list[str]:
        return list(answered(tmp_path, causes, delay, **truth)["why"])

    assert why([cause("imu_delay")]) == []
    told = why([cause("sensor_bandwidth", ("imu_delay",), (("imu_delay", 0.3),))])
    assert told == ["imu_delay: told as one that can't be told from sensor_bandwidth"]
    assert why([cause("sensor_bandwidth", (), (("imu_delay", 0.3),))]) == [
        "imu_delay: sensor_bandwidth gained more (0.30 is left for it)",
        "sensor_bandwidth too many: in place of imu_delay",
    ]
    untested = [{"effect": "imu_delay", "why": "shows by less than noise does"}]
    assert why([], could_not_test=untested) == ["imu_delay: the drive shows less of it than noise"]
    assert why([], level={"accel_y": 6.2, "gyro_z": 7.0}) == ["imu_delay: not named, while gyro_z stays 7 times off"]
    assert why([], level={"accel_y": 2.9}) == ["imu_delay: not named, and no channel stays more than 3 times off"]
    assert why([cause("imu_delay"), cause("wheel_slip")], level={"accel_y": 6.2}) == [
        "wheel_slip too many: named, while accel_y stays 6 times off"
    ]
    assert why([cause("imu_delay"), cause("wheel_slip")]) == [
        "wheel_slip too many: named, and no channel stays more than 3 times off"
    ]


def test_where_bars_are_missed_is_told_by_trial(tmp_path: Path) -> None:
    scale = [{"effect": "gyro_scale", "parameters": {"x": 0.05, "z": 0.02}}]
    one = answered(tmp_path, [cause("gyro_scale", x=(0.06, 0.004), z=(0.021, 0.01))], scale, number=7)
    delay = [{"effect": "imu_delay", "parameters": {}}]
    alias = answered(tmp_path, [cause("sensor_bandwidth", ("imu_delay",), (("imu_delay", 0.3),))], delay, size=0.1)
    ice = [{"effect": "low_friction", "parameters": {"start_s": 30.0, "end_s": 70.0}}]
    said = cause("low_friction", start_s=(50.0, None), end_s=(70.0, None))
    stretch = answered(tmp_path, [said], ice, number=9, group="local", car="own", kind="city")
    road = one | {"number": 11, "planted": ["road_bank"], "profile_rad": np.radians(0.25), "off": [], "off_of": []}
    told = missed([one, alias, stretch, road])
    assert "| singles of size 1 | 2 | 0.900 | 0.900 |" in told
    assert "| singles of size 0.1 | 1 | 0.270 | 0.900 |" in told
    assert "| slippery stretches | 1 | 0.900 | 0.900 |" in told
    assert "| gyro_scale.x | 1 | 1 | +2.5 |" in told
    assert "gyro_scale.z" not in told
    assert "| 9 | own, city | low_friction | 0.50 | 20.0 s | 0.0 s |" in told
    assert "| road_bank | 0.25 deg |" in told
    # Of a car that shakes itself nothing is told here, and where all is inside nothing is outside.
    assert missed([one | {"group": "as_published"}]).count("|") == missed([]).count("|")
    assert "outside" not in missed([road | {"profile_rad": 1e-4}])


def test_the_page_tells_failures_first(tmp_path: Path) -> None:
    good = answered(tmp_path, [cause("gyro_scale")], [{"effect": "gyro_scale", "parameters": {}}])
    bad = answered(tmp_path, [cause("wheel_slip")], [], group="null") | {"number": 77}
    protocol = {"trials": 2, "seed": 1, "version": "0", "judge": "0" * 64}
    written = page({"trials": [good, bad], "protocol": protocol, "summary": summary([good, bad])})
    failures = written[written.index("## Failures") : written.index("## By effect")]
    assert "| 77 |" in failures
    assert failures.count("\n| ") == 2
    assert "wheel_slip too many: named, and no channel stays more than 3 times off |" in failures
    assert "false alarms on nulls | 1 of 1" in written
    assert MILD <= 0.01
