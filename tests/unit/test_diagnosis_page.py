# ruff: noqa: RUF001  the page writes minus signs and powers as people do
"""The page of `dsz diagnose`: its sentence, numbers by hand, pictures, hostile text."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from diagnosis_page_cases import EVIL, NAN, cause, diagnosis, drive, fit, taken_apart
from report_cases import Page, assert_offline

from dsz_daemon.report.diagnosis_cards import cause_card
from dsz_daemon.report.diagnosis_channels import channels_of
from dsz_daemon.report.diagnosis_page import diagnosis_page
from dsz_daemon.report.diagnosis_words import end_of, is_spin, sentence, spins_of
from dsz_daemon.report.markup import element
from dsz_daemon.report.offline_page import Picture, plotly, section, write_page


def headings(folder: Path) -> list[str]:
    return re.findall("<h2[^>]*>([^<]*)", (folder / "report.html").read_text(encoding="utf-8"))


# The whole page


def test_everything_stands_in_its_order_and_each_picture_has_its_data(tmp_path: Path) -> None:
    page = taken_apart(tmp_path, diagnosis(next_manoeuvres=["Drive a slalom."]), drive())
    assert headings(tmp_path) == [
        "Cause",
        "Configured parameters that fit better otherwise",
        "Shapes without a name",
        "What to drive next",
        "Recording against simulation",
        "Fit on seen and unseen data",
        "What is left",
        "Where they part",
        "What this drive could not test",
        "Refitted before any cause",
    ]
    rest, folded = page.text.split("Settings and versions")
    assert "Refitted before" in rest
    assert '"dsz-daemon": "1.2.3"' in folded
    assert '"driven_axle": "front"' in folded
    assert "causes" not in folded
    places = [str(a["data-figure"]) for tag, a in page.tags if a.get("data-figure")]
    assert places == [*(f"channel-{i}" for i in range(9)), "bars", "spectra", "whiteness"]
    assert list(page.figures()) == [f"data-{name}" for name in places]
    alone = [str(a["data-figure"]) for _, a in page.tags if "data-alone" in a]
    assert alone == ["bars", "spectra", "whiteness"]


def test_the_page_is_offline(tmp_path: Path) -> None:
    assert_offline(taken_apart(tmp_path, diagnosis(), drive()))


def test_the_page_is_put_together_as_all_other_pages_are(tmp_path: Path) -> None:
    written = diagnosis_page(diagnosis(), drive(), "Same")
    picture = Picture("p", ["P"], "", {"data": [], "layout": {}})
    write_page(tmp_path / "other.html", "Same", [element("p"), section(picture)], [picture], plotly())
    other = (tmp_path / "other.html").read_text(encoding="utf-8")
    assert written.split("<body>")[0] == other.split("<body>")[0]
    ends = [text[text.rindex("<script>") :] for text in (written, other)]
    assert ends[0] == ends[1]


def test_text_of_a_recording_stays_text(tmp_path: Path) -> None:
    result = diagnosis(
        verdict=EVIL,
        causes=[
            cause(EVIL, statement=EVIL, equation=EVIL, next_manoeuvre=EVIL, indistinguishable_from=[EVIL],
                  alternatives=[{"effect": EVIL, "probability": 0.1}],
                  parameters={EVIL: {"value": EVIL, "unit": EVIL}, "k": {"value": 1.0, "std": 0.1, "unit": EVIL}})
        ],
        unlisted=[{"channel": EVIL, "shape": EVIL, "coefficient": {"value": 1.0, "unit": EVIL}}],
        located=[{"channel": EVIL, "start_s": 1.0, "end_s": 2.0, "share": 0.5}],
        fit={EVIL: fit(1.0, 0.5, EVIL)},
        level={EVIL: 9.0},
        parameter_errors=[{"parameter": EVIL, "configured": 1.0, "fitted": 2.0, "std": 0.1}],
        could_not_test=[{"effect": EVIL, "why": EVIL}],
        offsets={EVIL: {"value": 1.0}},
        next_manoeuvres=[{EVIL: EVIL}],
        source={"recording": [EVIL]},
        settings={EVIL: EVIL},
    )  # fmt: skip
    columns = drive(20.0)
    for what in ("measured", "nominal", "fitted"):
        columns[f"{EVIL}_{what}"] = columns[f"gyro_x_{what}"]
    page = taken_apart(tmp_path, result, columns, EVIL)
    assert not [text for text in page.scripts if text.strip() == "alert(1)"]
    assert len([tag for tag, _ in page.tags if tag == "script"]) == 2 + len(page.figures())
    # Statement, verdict, heading, title, tables, settings ...: all of it told, none of it obeyed.
    assert page.text.count(EVIL) > 20
    assert_offline(page)


def test_150_s_take_less_than_3_megabytes_beside_the_library() -> None:
    result = diagnosis(causes=[cause("road_bank")])
    assert len(diagnosis_page(result, drive(150.0), "Long").encode()) - len(plotly().encode()) < 3e6


# What may be missing


@pytest.mark.parametrize("key", sorted(diagnosis()))
def test_any_entry_may_be_missing_or_null(key: str, tmp_path: Path) -> None:
    without = {name: value for name, value in diagnosis().items() if name != key}
    for result in (without, without | {key: None}):
        assert "accel_y" in taken_apart(tmp_path, result, drive(12.0)).text or key == "fit"


def test_nothing_at_all_is_a_page(tmp_path: Path) -> None:
    page = taken_apart(tmp_path, {}, {})
    assert "This diagnosis has no verdict." in page.text
    assert not page.figures()
    assert_without_nan(page)


@pytest.mark.parametrize("gone", ["measured", "nominal", "fitted", "wheel_other_left", "gyro", "time_s", "road"])
def test_columns_may_be_missing(gone: str, tmp_path: Path) -> None:
    columns = {name: values for name, values in drive(20.0).items() if gone not in name}
    page = taken_apart(tmp_path, diagnosis(causes=[cause("road_bank")]), columns)
    drawn = [name for name in page.figures() if name.startswith("data-channel")]
    expected = {"measured": 0, "nominal": 0, "time_s": 0, "wheel_other_left": 8, "gyro": 6}
    assert len(drawn) == expected.get(gone, 9)


def test_values_that_are_none_are_told_as_dashes(tmp_path: Path) -> None:
    empty = {"effect": None, "parameters": {"a": None, "b": {"value": NAN, "std": None}, "c": 3.5, "d": {"value": "x"}}}
    rms = {"rms_rad": {"value": 0.03, "std": NAN, "unit": "rad"}}
    place = {"channel": "accel_y", "start_s": NAN, "end_s": None, "share": NAN, "region": {"speed_mps": [None, 3]}}
    result = diagnosis(
        causes=[cause(probability=NAN, gain=None, parameters=rms), empty],
        fit={"accel_y": fit(NAN, NAN) | {"noise_floor": None, "flexible": NAN}, "accel_x": None, "gyro_x": {}},
        level={"accel_y": NAN},
        located=[place, None],
        parameter_errors=[{"parameter": "x", "configured": 0.0, "fitted": NAN, "std": None}],
        offsets={"offset_gyro_z": None, "other": {"value": None}},
        unlisted=[{"channel": None}],
        could_not_test=[{}],
    )  # fmt: skip
    columns = drive(20.0)
    columns["gyro_y_measured"][:] = NAN
    columns["accel_x_fitted"][500:900] = NAN
    page = taken_apart(tmp_path, result, columns)
    # 0.03 rad are 1.719 deg.
    assert ["rms", "deg", "1.719", "–", "0.03000", "–", "rad"] in page.rows
    assert ["d", "", "x", "–", "–", "–", ""] in page.rows
    assert_without_nan(page)


def assert_without_nan(page: Page) -> None:
    assert not re.search(r"\b(nan|None|inf)\b", page.text.split("Settings and versions")[0])


# Sentence, cards and tables


def test_the_sentence_tells_the_cause_and_what_it_gains_on_unseen_data() -> None:
    told = sentence(diagnosis())
    assert told == (
        "The simulation leaves out that the IMU sits +0.48 m ahead of the C.G; with it, the error (rms) of lateral "
        "acceleration on unseen data falls from 0.800 to 0.0800 m/s² (−90 %)."
    )


def test_the_sentence_says_what_it_can_not_tell_apart_and_what_is_not_explained() -> None:
    result = diagnosis(
        verdict="partly_explained",
        causes=[
            cause(indistinguishable_from=["accel_scale", "suspension_roll"]),
            cause("wheel_slip"),
            cause("imu_delay"),
        ],
        level={"accel_z": 7.04, "gyro_x": 1.0},
    )
    told = sentence(result)
    assert "(or accel scale and suspension roll: this recording can't tell)" in told
    assert "with it and 2 more causes," in told
    assert "not all is explained: the error of vertical acceleration is 7.0 times what noise" in told
    assert told.endswith("longitudinal acceleration follows a shape without a name.")


def test_what_steers_the_simulation_and_ends_is_said_in_words() -> None:
    end = {
        "channel": "steering_wheel_angle",
        "shape": "|steering_wheel_angle| <= k",
        "coefficient": {"value": 0.698132, "std": 0.0, "unit": "rad"},
        "share": 0.31,
    }
    words = "steering wheel angle goes no further than 40.0 deg, though the car turns on (31% of the drive is left out)"
    assert end_of(end) == words
    assert end_of(end | {"share": None}) == words[: words.index(" (")]
    assert end_of(end | {"shape": "k*vx^2"}) == end_of({}) == ""
    told = sentence(diagnosis(verdict="unexplained", causes=[], unlisted=[end], level={"accel_z": 1.2}))
    assert told.endswith(f": {words}.")
    assert "follows a shape" not in told


def test_wheels_that_spin_or_slide_are_said_in_words() -> None:
    def spin(channel: str, when: str, k: float) -> dict[str, Any]:
        unit = "(m/s)/(m/s)"
        return {"channel": channel, "shape": f"k*vx from {when} s", "coefficient": {"value": k, "unit": unit}}

    spins = [
        spin("wheel_speed_fl", "38.0 to 38.9", 0.23),
        spin("wheel_speed_fl", "50.1 to 51.2", 0.21),
        spin("wheel_speed_fl", "55.0 to 56.0", -0.5),
        spin("wheel_speed_rl", "38.1 to 39.0", 0.25),
    ]
    square = {"channel": "accel_x", "shape": "k*vx^2", "coefficient": {"value": 0.1, "unit": "1/m"}}
    result = diagnosis(verdict="unexplained", causes=[], unlisted=[*spins, square], level={})
    out = "than the car rolls, which is left out of the fit"
    assert spins_of(result) == [
        f"the front left wheel spins: 38.0 to 38.9 s and 50.1 to 51.2 s, up to 23% faster {out}",
        f"the front left wheel slides: 55.0 to 56.0 s, up to 50% slower {out}",
        f"the rear left wheel spins: 38.1 to 39.0 s, up to 25% faster {out}",
    ]
    assert sentence(result).endswith(
        ": wheels spin or slide and longitudinal acceleration follows a shape without a name."
    )
    assert [is_spin(one) for one in (spins[0], square, {})] == [True, False, False]
    page = diagnosis_page(result, drive(), "Spins")
    assert f"<li>The rear left wheel spins: 38.1 to 39.0 s, up to 25% faster {out}.</li>" in page
    assert "<code>k*vx from" not in page
    assert "<code>k*vx^2</code>" in page
    assert "Wheels beyond their grip" not in diagnosis_page(diagnosis(unlisted=[square]), drive(), "None")


def test_a_gyro_that_a_road_was_integrated_from_is_no_evidence_for_it() -> None:
    fits = {"gyro_x": fit(1.0, 0.001, "rad/s"), "accel_y": fit(0.8, 0.4)}
    assert "lateral acceleration" in sentence(diagnosis(causes=[cause("road_bank")], fit=fits))
    assert "roll rate" in sentence(diagnosis(causes=[cause("road_grade")], fit=fits))


def test_without_a_gain_the_sentence_claims_none() -> None:
    for fits in ({"accel_y": fit(0.8, 0.79)}, {"accel_y": fit(0.8, 0.0)}, {"accel_y": fit(NAN, 0.1)}, {}):
        assert "with it the fit on unseen data is much as before." in sentence(diagnosis(fit=fits))


def test_wheels_and_rates_are_told_in_the_units_of_the_other_pages() -> None:
    told = sentence(diagnosis(fit={"wheel_speed_rr": fit(1.0, 0.5, "m/s")}))
    assert "rear wheel speeds, right − left on unseen data falls from 3.60 to 1.80 km/h (−50 %)" in told
    told = sentence(diagnosis(fit={"gyro_z": fit(math.pi / 180.0, math.pi / 360.0, "rad/s")}))
    assert "yaw rate on unseen data falls from 1.00 to 0.500 deg/s" in told


def test_an_axis_fault_is_not_called_physics(tmp_path: Path) -> None:
    parameters = {"channel": {"value": "accel_x", "std": None, "unit": None}, "kind": "reversed"}
    fault = cause("axis_fault", statement="accel_x is reversed", parameters=parameters)
    page = taken_apart(tmp_path, diagnosis(causes=[fault]), drive(20.0))
    assert "a fault that is no physics: accel_x is reversed; with that mended," in page.text
    assert ["channel", "accel_x"] in page.rows
    assert ["kind", "reversed"] in page.rows


def test_another_cars_configuration_is_not_called_physics(tmp_path: Path) -> None:
    parameters = {"cg_to_rear_axle_m": {"value": 0.8, "std": 0.01, "unit": "1"}}
    fault = cause("configuration", statement="The car is not the one that is configured", parameters=parameters)
    page = taken_apart(tmp_path, diagnosis(causes=[fault]), drive(20.0))
    assert "a fault that is no physics: the car is not the one that is configured; with that mended," in page.text
    [row] = [row for row in page.rows if row[0] == "from the C.G. to the rear axle"]
    assert row[1:3] == ["% more than configured", "−20.0"]


def test_consistent_is_said_calmly_with_one_simulation_and_lower_pictures(tmp_path: Path) -> None:
    calm = {"verdict": "consistent", "causes": [], "unlisted": [], "located": []}
    page = taken_apart(tmp_path, diagnosis(**calm, parameter_errors=[]), drive())
    assert "The simulation agrees with the recording: what is left is noise" in page.text
    assert "before" not in page.text.split("Refitted before")[0].lower()
    loud = taken_apart(tmp_path, diagnosis(), drive()).figures()
    for name, figure in page.figures().items():
        assert figure["layout"]["height"] <= loud[name]["layout"]["height"]
        assert not [trace for trace in figure["data"] if "after" in trace["name"]]
    assert page.figures()["data-channel-0"]["layout"]["height"] < 0.8 * loud["data-channel-0"]["layout"]["height"]
    told = sentence(diagnosis(**calm))
    assert "once the front tyres' cornering stiffness is 10 % below what is configured, within the tolerance" in told


def test_a_card_has_the_interval_in_display_units_and_in_si(tmp_path: Path) -> None:
    parameters = {
        # 0.02 rad = 1.1459 deg, +- 2 * 0.001 rad = 0.1146 deg.
        "roll_rad": {"value": 0.02, "std": 0.001, "unit": "rad"},
        # 1 rad/(m/s2) = 57.2958 * 9.80665 deg per g = 561.88.
        "roll_gradient_rad_per_mps2": {"value": 0.01, "std": 0.0005, "unit": "rad/(m/s2)"},
        "rad_per_n": {"value": -1e-6, "std": 1e-7, "unit": "rad/N"},
        "delay_s": {"value": 0.05, "std": 0.002, "unit": "s"},
    }
    rows = taken_apart(tmp_path, diagnosis(causes=[cause(parameters=parameters)]), drive(20.0)).rows
    assert ["roll", "deg", "1.15", "1.03 to 1.26", "0.0200", "0.0020", "rad"] in rows
    assert ["roll gradient", "deg per g", "5.62", "5.06 to 6.18", "0.0100", "0.0010", "rad/(m/s²)"] in rows
    assert ["give per force", "deg/kN", "−0.057", "−0.069 to −0.046", "−1.000·10⁻⁶", "2.0·10⁻⁷", "rad/N"] in rows
    assert ["delay", "ms", "50.0", "46.0 to 54.0", "0.0500", "0.0040", "s"] in rows


def test_a_ratio_is_told_as_what_it_is_more_than_configured(tmp_path: Path) -> None:
    radius = cause("wheel_radius", parameters={"fl": {"value": 1.0097, "std": 0.0005, "unit": "1"}})
    rows = taken_apart(tmp_path, diagnosis(causes=[radius]), drive(20.0)).rows
    assert ["fl", "% more than configured", "0.97", "0.87 to 1.07", "1.0097", "0.0010", ""] in rows


def test_what_can_not_be_told_apart_comes_with_its_probability(tmp_path: Path) -> None:
    odds = [{"effect": "accel_scale", "probability": 0.3}, {"effect": "imu_delay", "probability": 0.04}]
    one = cause(indistinguishable_from=["accel_scale"], alternatives=odds, next_manoeuvre="Brake hard three times.")
    text = taken_apart(tmp_path, diagnosis(causes=[one]), drive(20.0)).text
    assert "accel scale (30 %); less likely imu delay (4 %)" in text
    assert "Brake hard three times." in text
    assert "97 %" in text
    assert "log likelihood of unseen data rises by 123" in text


def test_tables_tell_parameters_shapes_places_fits_and_offsets(tmp_path: Path) -> None:
    page = taken_apart(tmp_path, diagnosis(), drive(20.0))
    stiffness = ["the front tyres' cornering stiffness", "kN/rad", "62.0", "55.80", "55.00 to 56.60", "−10 %"]
    assert stiffness in page.rows
    assert ["longitudinal acceleration", "k*vx^2", "0.00110", "0.00090 to 0.00130", "1/m"] in page.rows
    assert ["lateral acceleration", "20", "30", "41 %", "36 – 72", "2.0 – 5.0"] in page.rows
    assert ["lateral acceleration", "m/s²", "0.400 → 0.0400", "0.800 → 0.0800", "0.0100", "1.1"] in page.rows
    # 0.01 rad/s = 0.573 deg/s, +- 0.1146.
    assert ["offset of yaw rate", "deg/s", "0.57", "0.46 to 0.69"] in page.rows
    assert ["front cornering stiffness, change", "%", "−10.0", "−12.0 to −8.0"] in page.rows
    assert ["tyre saturation", "lateral acceleration stayed below 2.1 m/s2"] in page.rows


# Pictures


def test_mismatches_are_shaded_where_they_are_and_tell_their_share(tmp_path: Path) -> None:
    figures = taken_apart(tmp_path, diagnosis(), drive()).figures()
    shapes = figures["data-channel-4"]["layout"]["shapes"]
    assert [(shape["x0"], shape["x1"]) for shape in shapes] == [(20.0, 30.0), (40.0, 45.0)]
    bars = [trace for trace in figures["data-channel-4"]["data"] if trace["name"] == "mismatch"]
    assert bars[0]["customdata"] == ["41 %", "20 %"]
    assert not figures["data-channel-3"]["layout"].get("shapes")


def test_bars_show_the_diagnosis_own_numbers_and_the_floor(tmp_path: Path) -> None:
    result = diagnosis()
    result["fit"]["accel_y"]["flexible"] = 0.05
    result["fit"]["wheel_speed_rr"]["noise_floor"] = 0.0
    data = taken_apart(tmp_path, result, drive(20.0)).figures()["data-bars"]["data"]

    def of(axis: str) -> dict[str, list[float]]:
        return {trace["name"]: trace["y"] for trace in data if trace["xaxis"] == axis and trace["type"] == "bar"}

    def lines(axis: str) -> list[str]:
        return [trace["name"] for trace in data if trace["xaxis"] == axis and trace["type"] == "scatter"]

    assert of("x5") == {"before": [0.4, 0.8], "after": [0.04, 0.08]}
    assert of("x9")["before"] == pytest.approx([0.36, 0.72])
    assert of("x")["after"][1] == pytest.approx(5.729578)
    assert lines("x5") == ["noise floor", "what a model without names reaches"]
    assert lines("x4") == ["noise floor"]
    assert lines("x9") == []


def test_the_road_is_drawn_in_degrees_where_it_is_a_cause(tmp_path: Path) -> None:
    page = taken_apart(tmp_path, diagnosis(causes=[cause("road_bank")]), drive(20.0))
    assert "that gyro's own fit proves nothing" in page.text
    html = diagnosis_page(diagnosis(causes=[cause("road_bank")]), drive(20.0), "Bank")
    assert 'id="profile"' in html
    assert 'id="profile"' not in diagnosis_page(diagnosis(), drive(20.0), "No bank")
    windy = drive(20.0) | {"side_wind_n": np.full(2000, 150.0)}
    assert 'id="profile"' in diagnosis_page(diagnosis(causes=[cause("side_wind")]), windy, "Wind")
    # Level all along: not drawn.
    assert [note["text"] for note in page.figures()["data-profile"]["layout"]["annotations"]] == [
        "<b>road bank, left side up</b>  deg"
    ]


@pytest.mark.parametrize(
    ("axle", "names"),
    [
        ("front", ["wheel_speed_fl", "wheel_speed_fr", "wheel_speed_rr"]),
        ("rear", ["wheel_speed_rl", "wheel_speed_rr", "wheel_speed_fr"]),
        ("all", ["wheel_speed_fl", "wheel_speed_fr", "wheel_speed_rr"]),
    ],
)
def test_wheels_are_named_by_the_axle_that_gives_the_speed(axle: str, names: list[str]) -> None:
    channels = channels_of(diagnosis(settings={"vehicle": {"driven_axle": axle}}), drive(12.0))
    assert [channel.name for channel in channels[6:]] == names
    assert channels[8].title == f"{'front' if axle == 'rear' else 'rear'} wheel speeds, right − left"


def test_what_is_left_is_taken_while_driving_a_second_from_slow_and_from_the_ends() -> None:
    for channel in channels_of(diagnosis(), drive()):
        at_s = channel.time_s[channel.used]
        assert at_s[0] == pytest.approx(11.0, abs=0.02)
        assert at_s[-1] == pytest.approx(58.99, abs=0.02)
        assert np.all(np.isnan(channel.after[~channel.used]))


@pytest.mark.parametrize(
    ("source", "shown"), [("Newton", "a_IMU = a + w' x rho (Newton)"), ("", "a_IMU = a + w' x rho")]
)
def test_an_equation_says_where_it_is_from(source: str, shown: str) -> None:
    card = cause_card(cause(source=source), 1)
    [equation] = [part for part in card.iter("p") if part.get("class") == "equation"]
    assert "".join(equation.itertext()) == shown
