"""The paper's figures in `report.html`: when they are there, which, and that their numbers are those of the run."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from report_cases import Samples, assert_offline, full_run, page, small_run, small_truth, words

from dsz_daemon.report.paper_figures import (
    conditions_figure,
    magnified_figure,
    paper_pictures,
    readings_figure,
    references_figure,
    tilted_stretch_s,
    zeroing_begins_s,
)
from dsz_daemon.report.results import channel_result, mapped_channels
from dsz_daemon.report.rms_bars import rms_bars

DEG = 180.0 / np.pi


def lateral_run() -> Samples:
    """Ten seconds at 10 Hz: lateral learning begins at 6 s; all readings count the rows."""
    t = np.arange(100) / 10.0
    return {
        "time_s": 1e9 + t,
        "accel_y_raw_mps2": np.arange(100.0),
        "accel_y_mps2": np.arange(100.0) - 1.0,
        "accel_y_offset_mps2": np.ones(100),
        "accel_y_kinematic_mps2": np.full(100, 3.0),
        "accel_y_gate": t >= 6.0,
        "accel_y_reason": words(*np.where(t >= 6.0, "none", "too_slow")),
        "accel_y_state": words(*np.where(t >= 6.0, "learning", "holding")),
    }


def lateral_truth(bank_deg: float = 0.0, grade_up_deg: float = 0.0) -> Samples:
    """Truth 2 m/s2 below the raw reading; the road is tilted from 2 to 3 s and from 4 to 8 s."""
    t = np.arange(100) / 10.0
    tilted = ((t >= 2.0) & (t <= 3.0)) | ((t >= 4.0) & (t <= 8.0))
    return {
        "time_s": 1e9 + t,
        "accel_y_mps2": np.arange(100.0) - 2.0,
        "speed_mps": np.full(100, 10.0),
        "roll_rad": np.full(100, 0.1),
        "pitch_rad": np.full(100, 0.2),
        "road_bank_rad": np.where(tilted, bank_deg / DEG, 0.0),
        "road_grade_up_rad": np.where(tilted, grade_up_deg / DEG, 0.0),
    }


def names(samples: Samples, truth: Samples) -> list[str]:
    results = [channel_result(c, samples, {}, truth) for c in mapped_channels(samples, {})]
    return [picture.name for picture in paper_pictures(results, samples, truth)]


def test_the_section_is_there_with_a_truth_and_not_without(tmp_path: Path) -> None:
    with_truth = page(tmp_path, lateral_run(), {}, truth=lateral_truth())
    assert "The paper's figures" in with_truth.text
    assert "As Fig. 2: readings" in with_truth.text
    assert "data-paper-2" in with_truth.figures()
    without = page(tmp_path, lateral_run(), {})
    assert "The paper's figures" not in without.text
    assert not [name for name in without.figures() if "paper" in name]
    assert "data-kinematics" in without.figures()


def test_a_truth_that_knows_nothing_of_the_run_makes_no_section(tmp_path: Path) -> None:
    found = page(tmp_path, lateral_run(), {}, truth={"time_s": lateral_run()["time_s"]})
    assert "The paper's figures" not in found.text


def test_a_flat_road_gives_the_first_set_and_a_hill_with_a_bank_the_second() -> None:
    assert names(lateral_run(), lateral_truth()) == ["paper-2", "paper-3", "paper-4", "paper-5"]
    hill = lateral_truth(bank_deg=5.8, grade_up_deg=-6.5)
    assert names(lateral_run(), hill) == [f"paper-{n}" for n in range(6, 12)]
    # A grade alone is no flat road, but has no stretch with both angles.
    assert names(lateral_run(), lateral_truth(grade_up_deg=1.1)) == [f"paper-{n}" for n in (6, 7, 8, 10, 11)]
    assert names(lateral_run(), lateral_truth(bank_deg=0.9, grade_up_deg=-0.9)) == names(lateral_run(), lateral_truth())


def test_the_page_says_like_which_figures_and_never_that_it_is_them(tmp_path: Path) -> None:
    text = page(tmp_path, lateral_run(), {}, truth=lateral_truth(5.8, -6.5)).text
    assert "Drawn of this run like Figs 6 to 11 of Oh & Choi 2013" in text
    assert "Figs 2 to 5" not in text
    assert "As Fig. 10: reference accelerations" in text
    assert "at 6.0 s" in text
    assert "4 to 8 s" in text


def test_the_bars_are_the_errors_computed_by_hand() -> None:
    """Raw and compensated as in `report_cases`; offset minus 0.04: RMS sqrt(0.0022 / 4) = 0.0234521 rad/s."""
    samples, truth = small_run(), small_truth()
    figure = rms_bars([channel_result("gyro_z", samples, {}, truth)], samples, truth)
    assert figure is not None
    bars = {bar["name"]: bar["y"] for bar in figure["data"]}
    assert bars["raw"] == pytest.approx([0.0483046 * DEG], rel=1e-5)
    assert bars["compensated"] == pytest.approx([0.0251661 * DEG], rel=1e-5)
    assert bars["offset alone"] == pytest.approx([0.0234521 * DEG], rel=1e-5)
    assert [bar["x"] for bar in figure["data"]] == [["yaw rate"]] * 3
    assert figure["data"][0]["text"] == ["2.768"]


def test_rates_and_accelerations_stand_on_axes_of_their_own() -> None:
    """accel_y: raw is 2 off, compensated 1, its offset's truth is not known."""
    samples = small_run() | {k: v[:4] for k, v in lateral_run().items() if k.startswith("accel")}
    truth = small_truth() | {"accel_y_mps2": lateral_truth()["accel_y_mps2"][:4]}
    results = [channel_result(c, samples, {}, truth) for c in ("gyro_z", "accel_y")]
    figure = rms_bars(results, samples, truth)
    assert figure is not None
    found = [(bar["name"], bar["yaxis"], bar["y"]) for bar in figure["data"] if bar["x"] == ["lateral"]]
    assert found == [("raw", "y2", [2.0]), ("compensated", "y2", [1.0])]
    assert [bar["name"] for bar in figure["data"] if bar["showlegend"]] == ["raw", "compensated", "offset alone"]


def test_without_any_error_there_are_no_bars() -> None:
    samples = small_run()
    assert rms_bars([channel_result("gyro_z", samples, {}, None)], samples, {"time_s": samples["time_s"]}) is None


def test_a_missing_channel_leaves_its_panels_out() -> None:
    samples, truth = full_run(60)
    channels = mapped_channels(samples, {})
    whole = readings_figure(channels, samples, truth)
    assert whole is not None
    assert sum(name.startswith("yaxis") for name in whole["layout"]) == 6
    for name in [n for n in samples if n.startswith(("gyro_y", "accel_z_"))]:
        del samples[name]
    left = mapped_channels(samples, {})
    for figure, panels in (
        (readings_figure(left, samples, truth), 4),
        (magnified_figure(left, samples, truth, (0.1, 0.4)), 5),
        (references_figure(samples, truth), 4),
    ):
        assert figure is not None
        assert sum(name.startswith("yaxis") for name in figure["layout"]) == panels
        labels = " ".join(note["text"] for note in figure["layout"]["annotations"])
        assert "pitch rate" not in labels
        assert "vertical" not in labels


def test_any_column_may_be_missing() -> None:
    samples, truth = full_run(60)
    truth |= {"road_bank_rad": np.full(60, 0.1), "road_grade_up_rad": np.full(60, 0.1)}
    for gone in [name for name in samples if name != "time_s"]:
        names({name: values for name, values in samples.items() if name != gone}, truth)
    for gone in [name for name in truth if name != "time_s"]:
        names(samples, {name: values for name, values in truth.items() if name != gone})


def test_the_readings_are_raw_compensated_and_true() -> None:
    figure = readings_figure(["accel_y"], lateral_run(), lateral_truth())
    assert figure is not None
    lines = {trace["name"]: trace for trace in figure["data"]}
    np.testing.assert_allclose(lines["raw"]["y"], np.arange(100.0))
    np.testing.assert_allclose(lines["compensated"]["y"], np.arange(100.0) - 1.0)
    np.testing.assert_allclose(lines["truth"]["y"], np.arange(100.0) - 2.0)
    np.testing.assert_allclose(lines["truth"]["x"], np.arange(100) / 10.0, atol=1e-5)


def test_a_magnified_stretch_has_its_rows_and_its_gate_alone() -> None:
    figure = magnified_figure(["accel_y"], lateral_run(), lateral_truth(), (5.0, 7.0))
    assert figure is not None
    assert figure["layout"]["xaxis"]["range"] == [5.0, 7.0]
    raw = next(trace for trace in figure["data"] if trace["name"] == "raw")
    np.testing.assert_allclose(raw["y"], np.arange(50.0, 71.0))
    strips = [t for t in figure["data"] if t["type"] == "bar"]
    told = [(t["base"].tolist(), t["x"].tolist(), t["customdata"], t["y"]) for t in strips]
    assert told[0] == ([5.0], [1.0], ["no: too slow"], ["accel_y"])
    assert told[1][0] == [6.0]
    assert told[1][2] == ["yes (learning)"]


def test_a_stretch_never_leaves_the_run() -> None:
    figure = magnified_figure(["accel_y"], lateral_run(), lateral_truth(), (-3.0, 70.0))
    assert figure is not None
    np.testing.assert_allclose(figure["layout"]["xaxis"]["range"], [0.0, 9.9])
    assert magnified_figure(["accel_y"], lateral_run(), lateral_truth(), (50.0, 70.0)) is None


def test_zeroing_begins_where_the_lateral_gate_first_opens() -> None:
    run = lateral_run()
    assert zeroing_begins_s(run) == pytest.approx(6.0)
    assert zeroing_begins_s(run | {"accel_y_gate": np.zeros(100, dtype=bool)}) is None
    assert zeroing_begins_s(run | {"accel_y_gate": np.ones(100, dtype=bool)}) is None
    assert zeroing_begins_s({"time_s": run["time_s"]}) is None


def test_the_tilted_stretch_is_the_longest_with_both_angles() -> None:
    assert tilted_stretch_s(lateral_run(), lateral_truth(5.8, -6.5)) == pytest.approx((4.0, 8.0), abs=1e-6)
    assert tilted_stretch_s(lateral_run(), lateral_truth(5.8, 0.0)) is None
    to_the_end = lateral_truth()
    to_the_end |= {n: np.full(100, 0.1) for n in ("road_bank_rad", "road_grade_up_rad")}
    assert tilted_stretch_s(lateral_run(), to_the_end) == pytest.approx((0.0, 9.9), abs=1e-6)


def test_conditions_are_in_kmh_and_degrees_with_nose_down_positive() -> None:
    figure = conditions_figure(lateral_run(), lateral_truth(5.8, -6.5))
    assert figure is not None
    lines = {(trace["yaxis"], trace["name"]): trace["y"] for trace in figure["data"]}
    assert lines["y", "speed"][0] == pytest.approx(36.0)
    assert lines["y2", "car's roll"][0] == pytest.approx(0.1 * DEG)
    assert lines["y2", "road's bank"][50] == pytest.approx(5.8)
    assert lines["y3", "car's pitch"][0] == pytest.approx(0.2 * DEG)
    assert lines["y3", "road's grade, downhill"][50] == pytest.approx(6.5)


def test_references_stand_beside_the_truth_with_their_gate() -> None:
    figure = references_figure(lateral_run(), lateral_truth())
    assert figure is not None
    assert [trace["name"] for trace in figure["data"]][:2] == ["reference, from motion", "truth"]
    np.testing.assert_allclose(figure["data"][0]["y"], 3.0)
    np.testing.assert_allclose(figure["data"][1]["y"], np.arange(100.0) - 2.0)
    assert {trace["type"] for trace in figure["data"][2:]} == {"bar"}


def test_what_has_an_axis_of_its_own_does_not_follow_the_others(tmp_path: Path) -> None:
    found = page(tmp_path, lateral_run(), {}, truth=lateral_truth(5.8, -6.5))
    plots = {str(a["data-figure"]): "data-alone" in a for _, a in found.tags if a.get("data-figure")}
    alone = {"paper-8", "paper-9", "paper-11"}
    assert {name for name, is_alone in plots.items() if is_alone} == alone
    assert {"paper-6", "paper-7", "paper-10", "accel_y"} <= set(plots)
    assert_offline(found)
