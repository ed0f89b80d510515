"""`drive.html`: the way, the course over time and distance, what was true; and how `dsz simulate` comes by it."""

from __future__ import annotations

import json
import math
import sys
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from report_cases import Page, Samples, assert_offline

from dsz_daemon.errors import MachineError
from dsz_daemon.report.truth_figures import distance_figure, path_figure, time_figure
from dsz_daemon.report.truth_page import write_truth_page
from dsz_daemon.report.truth_table import named_unit, truth_tables
from dsz_daemon.runs import screen
from dsz_daemon.runs.simulate import simulate
from dsz_daemon.sim.car import Car
from dsz_daemon.sim.catalogue import SCENARIOS, Scenario
from dsz_daemon.sim.driver import Programme, SpeedChange
from dsz_daemon.sim.road import FLAT
from dsz_daemon.sim.sensors import CrossAxis, PoleRing, SensorErrors, WarmUp

DEG = 180.0 / math.pi
EVIL = "<script>alert(1)</script>"


def climb(rows: int = 1001) -> Samples:
    """100 s at 10 m/s to the north-east, up by 1 in 10 of the way; it stands for the last 10 s."""
    t = np.linspace(0.0, 100.0, rows)
    driven = np.minimum(10.0 * t, 900.0)
    return {
        "time_s": 1.7e9 + t,
        "speed_mps": np.where(t < 90.0, 10.0, 0.0),
        "east_m": 0.6 * driven,
        "north_m": 0.8 * driven,
        "height_m": 0.1 * driven,
        "distance_m": driven,
        "road_grade_up_rad": np.full(rows, 0.1),
        "road_bank_rad": np.zeros(rows),
        "roll_rad": np.zeros(rows),
        "pitch_rad": np.full(rows, -0.1),
        "steering_wheel_angle_rad": np.full(rows, 0.5),
        "road_wheel_angle_rad": np.full(rows, 0.03),
        "accel_x_mps2": np.full(rows, 0.98),
        "accel_y_mps2": np.full(rows, -2.5),
        "gyro_z_radps": np.full(rows, 0.1),
        "sideslip_rad": np.zeros(rows),
        "friction": np.full(rows, 1.0),
        "side_wind_n": np.zeros(rows),
    }


def standing() -> Samples:
    return climb() | {name: np.zeros(1001) for name in ("speed_mps", "east_m", "north_m", "height_m", "distance_m")}


def parameters(errors: SensorErrors | None = None, car: Car | None = None, **more: Any) -> dict[str, Any]:
    found = {"meaning": "up a hill", "car": asdict(car or Car()), "sensors": asdict(errors or SensorErrors())}
    return found | more


def page(folder: Path, truth: Samples, told: dict[str, Any], name: str = "climb") -> Page:
    write_truth_page(name, 7, truth, told, folder / "drive.html")
    return Page(folder / "drive.html")


def panels(figure: dict[str, Any] | None) -> list[str]:
    assert figure is not None
    return [note["text"].split("</b>")[0].removeprefix("<b>") for note in figure["layout"]["annotations"]]


def test_the_page_has_its_three_pictures_and_loads_nothing(tmp_path: Path) -> None:
    found = page(tmp_path, climb(), parameters())
    assert list(found.figures()) == ["data-way", "data-time", "data-distance"]
    alone = [a["data-figure"] for _, a in found.tags if "data-alone" in a]
    assert alone == ["way", "distance"]
    assert_offline(found)
    for words in ("Simulated drive climb, seed 7", "Up a hill.", "900 m", "up to 36 km/h", "90 m between", "2.5 m/s"):
        assert words in found.text
    assert "a level road" not in found.text


def test_names_are_text(tmp_path: Path) -> None:
    told = parameters(meaning=EVIL, effects=[{"effect": EVIL, "parameters": {EVIL: EVIL}}])
    found = page(tmp_path, climb(), told, EVIL)
    assert not [s for s in found.scripts if "alert(1)" in s]
    assert found.text.count("alert(1)") >= 4


def test_the_way_is_east_and_north_at_equal_scales_coloured_by_speed() -> None:
    figure = path_figure(climb())
    assert figure is not None
    assert figure["layout"]["yaxis"]["scaleanchor"] == "x"
    way = figure["data"][figure["layout"]["meta"]["way"]]
    assert (way["x"][0], way["y"][0]) == (0.0, 0.0)
    assert (way["x"][-1], way["y"][-1]) == (540.0, 720.0)
    assert way["marker"]["color"][0] == pytest.approx(36.0)
    # Time, distance and height in the middle of the way.
    middle = way["x"].index(270.0)
    assert way["customdata"][middle] == [45.0, 450.0, 45.0]
    start, end = figure["data"][2:4]
    assert (start["text"], start["x"], end["text"], end["x"]) == (["start"], [0.0], ["end"], [540.0])
    assert figure["data"][figure["layout"]["meta"]["here"]]["x"] == []


def test_times_along_the_way_are_named_where_there_is_room() -> None:
    """Every 10 s; from 90 s on it stands at its end, whose name is there already."""
    figure = path_figure(climb())
    assert figure is not None
    named = figure["data"][5]
    assert named["text"] == ["10 s", "20 s", "30 s", "40 s", "50 s", "1 min", "1 min 10 s", "1 min 20 s"]
    np.testing.assert_allclose(named["x"], 0.6 * 10.0 * np.arange(10.0, 90.0, 10.0))


def test_a_car_that_stands_has_no_way_and_a_flat_road_no_profile(tmp_path: Path) -> None:
    assert path_figure(standing()) is None
    assert distance_figure(standing()) is None
    level = climb() | {name: np.zeros(1001) for name in ("height_m", "road_grade_up_rad")}
    assert distance_figure(level) is None
    found = page(tmp_path, level, parameters())
    assert "a level road" in found.text
    assert list(found.figures()) == ["data-way", "data-time"]


def test_over_distance_the_standstill_takes_no_room() -> None:
    figure = distance_figure(climb())
    assert panels(figure) == ["height", "grade, uphill positive"]
    assert figure is not None
    assert figure["layout"]["xaxis"]["range"] == [0.0, 900.0]
    assert figure["layout"]["xaxis"]["ticksuffix"] == " m"
    height, grade = figure["data"]
    np.testing.assert_allclose(height["y"], 0.1 * height["x"], atol=1e-3)
    np.testing.assert_allclose(grade["y"], 0.1 * DEG, rtol=1e-6)


def test_a_car_that_swings_back_as_it_stops_keeps_to_its_furthest_place() -> None:
    """In the last second it swings back by 2 cm, and forth again by 1 cm."""
    swung = climb()
    swung["distance_m"] = swung["distance_m"] - np.interp(np.arange(1001), [990, 994, 998], [0.0, 0.02, 0.01])
    figure = distance_figure(swung)
    assert figure is not None
    assert figure["layout"]["xaxis"]["range"] == [0.0, 900.0]
    assert np.all(np.diff(figure["data"][0]["x"]) > 0.0)


def test_over_time_everything_is_in_plain_units() -> None:
    figure = time_figure(climb())
    assert figure is not None
    found = {trace["name"]: trace["y"][0] for trace in figure["data"]}
    assert found == pytest.approx(
        {
            "speed": 36.0,
            "steering wheel": 0.5 * DEG,
            "road wheel": 0.03 * DEG,
            "longitudinal": 0.98,
            "lateral": -2.5,
            "yaw rate": 0.1 * DEG,
            "sideslip": 0.0,
            "road's bank": 0.0,
            "car's roll": 0.0,
            # Uphill is nose up, and nose down is positive: road and car lie on each other.
            "road's grade, downhill": -0.1 * DEG,
            "car's pitch": -0.1 * DEG,
        }
    )


def test_grip_is_drawn_where_it_is_less_than_on_dry_asphalt_and_wind_where_it_blows() -> None:
    dry = panels(time_figure(climb() | {"friction": np.full(1001, 1e6)}))
    assert "grip" not in dry
    assert "side wind" not in dry
    snow = climb() | {"side_wind_n": np.linspace(0.0, 400.0, 1001), "friction": np.full(1001, 0.3)}
    assert panels(time_figure(snow))[-2:] == ["grip", "side wind"]


def test_any_column_may_be_missing(tmp_path: Path) -> None:
    for gone in [name for name in climb() if name != "time_s"]:
        page(tmp_path, {name: values for name, values in climb().items() if name != gone}, parameters())


def test_errors_of_the_sensors_are_in_plain_units(tmp_path: Path) -> None:
    errors = replace(
        SensorErrors(),
        gyro_offset_radps=(0.01, -0.02, 0.0),
        accel_scale=(0.002, 0.0, -0.001),
        gyro_cross_axis=CrossAxis(xy=0.01, zx=-0.03),
        accel_drift_mps2_per_s=(0.001, 0.0, 0.0),
        gyro_g_sensitivity=((0.0, 0.0, 0.0), (0.0, 0.0, 0.001), (0.0, 0.0, 0.0)),
        warm_up=WarmUp(20.0, 45.0, 300.0),
        imu_delay_s=0.02,
        steering_offset_rad=0.01,
        pole_ring=PoleRing(48, off_pitches=((0.03, -0.03), (), (), ())),
    )
    found = page(tmp_path, climb(), parameters(errors))
    for row in (
        ["gyro offset", "0.573", "−1.146", "0", "deg/s"],  # noqa: RUF001
        ["accel scale", "0.2", "0", "−0.1", "%"],  # noqa: RUF001
        ["gyro cross axis, into x", "–", "1", "0", "%"],  # noqa: RUF001
        ["gyro cross axis, into z", "−3", "0", "–", "%"],  # noqa: RUF001
        ["accel drift over time", "0.06", "0", "0", "m/s² per minute"],
        ["gyro g sensitivity, into y", "0", "0", "0.0573", "deg/s per m/s²"],
    ):
        assert row in found.rows
    for words in ("imu delay0.02 s", "steering offset0.573 deg", "warm up start20 °C", "warm up time constant300 s"):
        assert words in found.text
    assert "48 poles, off by 3.0 % of a pitch (RMS)" in found.text
    off = found.text.split("As meant or nominal: ")[1].split(".")[0]
    assert "gyro nonlinearity" in off
    assert "accel offset" in off
    assert "gyro offset" not in off


def test_what_differs_from_the_catalogues_car_says_so(tmp_path: Path) -> None:
    text = page(tmp_path, climb(), parameters(car=Car(mass_kg=1973.0, wheel_radius_scale=(0.99, 1.0, 1.0, 1.0)))).text
    assert "mass1973 kg, else 1673" in text
    assert "wheel radius scale0.99 / 1 / 1 / 1, else 1 / 1 / 1 / 1" in text
    assert "rear track1.586 m" in text
    assert text.count(", else ") == 2


def test_effects_are_told_with_their_parameters(tmp_path: Path) -> None:
    told = parameters(effects=[{"effect": "imu_delay", "parameters": {"delay_s": 0.03}}], nominal=True)
    text = page(tmp_path, climb(), told).text
    assert "imu_delay: " in text
    assert "(delay_s = 0.03)" in text
    assert "nominal simulation" in text
    plain = page(tmp_path, climb(), parameters()).text
    assert "Effects put in" not in plain
    assert "nominal simulation" not in plain


def test_every_number_of_car_and_sensors_is_told_once() -> None:
    """Whatever field is added later turns up by itself, in its own unit or bare."""
    told = "".join("".join(part.itertext()) for part in truth_tables(parameters()))
    for name in (*asdict(Car()), *asdict(SensorErrors())):
        assert named_unit(name)[0] in told


def test_a_folder_that_cannot_be_written_is_a_machine_error(tmp_path: Path) -> None:
    with pytest.raises(MachineError, match=r"drive\.html: can't write the report"):
        write_truth_page("climb", 1, climb(), parameters(), tmp_path / "nowhere" / "drive.html")


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> str:
    """A drive of three seconds, in the catalogue as long as the test lasts."""
    drive = Scenario("a short drive", Car(), FLAT, Programme(3.0, (SpeedChange(0.2, 1.2, 6.0),)))
    monkeypatch.setitem(SCENARIOS, "short", drive)
    return "short"


def test_simulate_writes_the_picture_and_says_where(
    short: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    summary = simulate(short, tmp_path, 3)
    assert summary["picture"] == str(tmp_path / "drive.html")
    assert summary["notes"] == []
    found = Page(tmp_path / "drive.html")
    assert "Simulated drive short, seed 3" in found.text
    assert list(found.figures()) == ["data-way", "data-time"]
    json.dumps(summary["picture"])
    screen.print_simulation(summary)
    assert f"picture: {tmp_path / 'drive.html'}\n" in capsys.readouterr().out


def test_without_plotly_the_rest_is_written_and_the_summary_says_what_is_missing(
    short: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "drive.html").write_text("of an earlier drive")
    monkeypatch.setitem(sys.modules, "plotly.offline", None)
    summary = simulate(short, tmp_path, 3)
    assert summary["picture"] is None
    assert not (tmp_path / "drive.html").exists()
    assert (tmp_path / "truth.parquet").exists()
    screen.print_simulation(summary)
    told = capsys.readouterr().out
    assert "note: no picture of the drive: drive.html needs plotly" in told
    assert "pip install dsz-daemon[desk]" in told
    assert "picture:" not in told.replace("no picture", "")
