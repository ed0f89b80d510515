# ruff: noqa: RUF001  the page writes sigma, dashes and angle marks as people do
"""`report.html`: the numbers, the pictures' data, what is escaped, and that nothing is loaded.

The run whose numbers were computed by hand is in `report_cases`.
"""

from __future__ import annotations

import base64
import importlib
import json
import math
import sys
from pathlib import Path

import numpy as np
import pytest
from report_cases import NAN, Samples, assert_offline, full_run, page, small_run, small_truth

from dsz_daemon.errors import MachineError
from dsz_daemon.report import write_report
from dsz_daemon.report.channel_figures import channel_figure
from dsz_daemon.report.drive_figures import attitude_figure, drive_figure, kinematics_figure, model_figure
from dsz_daemon.report.markup import data_block, script
from dsz_daemon.report.offline_page import figure_json
from dsz_daemon.report.results import channel_result
from dsz_daemon.signals import IMU_CHANNELS

EVIL = "<script>alert(1)</script>.log"


def test_the_table_says_what_was_computed_by_hand(tmp_path: Path) -> None:
    row = page(tmp_path, small_run(), {}, truth=small_truth()).cells("gyro_z")
    assert row["channel"] == "gyro_z yaw rate"
    assert row["at the end"] == "invalid, stale"
    assert row["final, ± 2σ (95 %)"] == "+2.865 ± 1.146"
    assert (row["true"], row["error"], row["error/σ"]) == ("+2.292", "+0.573", "+1.0")
    assert row["share of time"] == "50 %"
    assert row["converged after, s"] == "2.0"
    assert row["mean"] == "+6.875 → +5.539"
    assert row["RMS"] == "6.939 → 5.545"
    assert row["RMS error"] == "2.768 → 1.442"
    # Against the reference of 0.09 rad/s: raw 0.01, 0.03, 0.05; compensated 0.01, 0.01, 0.00.
    assert row["mean minus ref."] == "+1.719 → +0.382"


def test_without_truth_and_reference_their_columns_are_left_out(tmp_path: Path) -> None:
    samples = small_run()
    del samples["yaw_rate_reference_radps"]
    headings = page(tmp_path, samples, {}).cells("gyro_z")
    assert not {"true", "error", "error/σ", "RMS error", "mean minus ref."} & set(headings)


def test_accelerations_are_shown_in_metres_per_second_squared(tmp_path: Path) -> None:
    names = {k: k.replace("gyro_z", "accel_y").replace("radps", "mps2") for k in small_run()}
    found = page(tmp_path, {names[k]: v for k, v in small_run().items()}, {})
    assert found.cells("accel_y")["final, ± 2σ (95 %)"] == "+0.050 ± 0.020"
    assert ["in m/s²"] in found.rows


def test_what_the_samples_lack_comes_from_the_summary(tmp_path: Path) -> None:
    told = {"offset": 0.02, "offset_std": 0.001, "state": "holding", "reason": "too_slow"}
    row = page(tmp_path, {}, {"channels": {"gyro_x": told}}).cells("gyro_x")
    assert row["final, ± 2σ (95 %)"] == "+1.146 ± 0.115"
    assert row["at the end"] == "holding, too slow"


def test_the_text_of_a_channel_says_what_kept_it_from_learning(tmp_path: Path) -> None:
    text = page(tmp_path, small_run(), {}).text
    assert "Learning 50 % of the time; not while: turning 25 %, stale 25 %." in text


def test_exactly_the_mapped_channels_are_drawn_and_each_place_has_its_data(tmp_path: Path) -> None:
    samples, truth = full_run(60)
    for name in [n for n in samples if n.startswith(("gyro_y", "accel_z_"))]:
        del samples[name]
    found = page(tmp_path, samples, {}, truth=truth)
    places = [str(a["data-figure"]) for tag, a in found.tags if a.get("data-figure")]
    channels = ["gyro_x", "gyro_z", "accel_x", "accel_y"]
    # The accelerations from motion are among the paper's figures where there is a truth.
    own = [name for name in places if not name.startswith("paper-")]
    assert own == [*channels, "drive", "model", "attitude"]
    assert list(found.figures()) == [f"data-{name}" for name in places]


def test_user_text_is_text_everywhere(tmp_path: Path) -> None:
    summary = {
        "recording": [EVIL],
        "warnings": [f"{EVIL}: cut"],
        "notes": [EVIL],
        "counts": {EVIL: 3, "roles": {EVIL: {EVIL: 1}}},
        "median_age_s": {EVIL: 0.1},
        "settings": {EVIL: EVIL},
        "versions": {"dsz-daemon": EVIL},
    }
    samples = small_run()
    samples["gyro_z_reason"][3] = "</script><script>alert(1)"
    found = page(tmp_path, samples, summary, title=f'run {EVIL} & "more"')
    figures = len(found.figures())
    assert len(found.scripts) == figures + 2
    # Only as data, in which no tag can begin; the words that a figure shows are user text, too.
    assert all("<" not in s for s in found.scripts if "alert(1)" in s)
    assert sum("alert(1)" in s for s in found.scripts) == 1
    assert found.text.count("<script>alert(1)</script>") >= 8
    assert f'run {EVIL} & "more"' in found.text


def test_a_file_name_that_is_no_text_does_not_stop_the_report(tmp_path: Path) -> None:
    assert "broken\\udcff.log" in page(tmp_path, {}, {"recording": ["broken\udcff.log"]}).text


def test_the_page_loads_nothing_and_forbids_the_browser_to(tmp_path: Path) -> None:
    found = page(tmp_path, small_run(), {"recording": ["a.log"], "settings": {"x": 1}})
    assert_offline(found)


def test_an_hour_at_100_hz_stays_below_12_megabytes(tmp_path: Path) -> None:
    samples, truth = full_run(360_000)
    write_report(samples, {}, tmp_path / "report.html", truth)
    assert (tmp_path / "report.html").stat().st_size < 12e6


@pytest.mark.parametrize("samples", [{}, {k: v[:0] for k, v in small_run().items()}, {"time_s": np.array([NAN])}])
def test_a_run_without_rows_still_says_why(tmp_path: Path, samples: Samples) -> None:
    warning = "recording.log: no frame has an id that the configuration names"
    found = page(tmp_path, samples, {"warnings": [warning], "counts": {"frames": 120}})
    assert "No step was written" in found.text
    assert warning in found.text
    assert "120" in found.text
    assert not found.scripts


def test_any_column_may_be_missing() -> None:
    samples, truth = full_run(40)
    for gone in [name for name in samples if name != "time_s"]:
        rest = {name: values for name, values in samples.items() if name != gone}
        for channel in IMU_CHANNELS:
            channel_figure(channel, rest, truth)
            channel_result(channel, rest, {}, truth)
        for figure in (drive_figure, model_figure, attitude_figure):
            figure(rest, truth)
        kinematics_figure(rest)


def test_a_column_that_is_all_nan_is_no_picture() -> None:
    samples, _ = full_run(40)
    gone = {name: np.full(40, NAN) if "kinematic" in name else v for name, v in samples.items()}
    assert kinematics_figure(gone) is None
    assert kinematics_figure(samples) is not None


def test_writing_changes_neither_samples_nor_summary(tmp_path: Path) -> None:
    samples, truth = full_run(60)
    for values in (*samples.values(), *truth.values()):
        values.flags.writeable = False
    summary = {"counts": {"gaps": 1}, "warnings": ["w"]}
    write_report(samples, summary, tmp_path / "report.html", truth)
    assert summary == {"counts": {"gaps": 1}, "warnings": ["w"]}


def test_the_picture_is_in_degrees_per_second_from_the_start_with_the_gap_marked() -> None:
    figure = channel_figure("gyro_z", small_run(), small_truth())
    assert figure is not None
    traces = {trace["name"]: trace for trace in figure["data"]}
    np.testing.assert_allclose(traces["raw"]["x"], [0.0, 1.0, 2.0])
    np.testing.assert_allclose(traces["raw"]["y"], [5.729578, 6.875494, 8.021409], rtol=1e-6)
    np.testing.assert_allclose(traces["truth"]["y"], [4.010705, 4.010705, 4.583662, 5.156620], rtol=1e-6)
    np.testing.assert_allclose(traces["true offset"]["y"], 2.291831, rtol=1e-6)
    # On hover the offset carries its 95 % spread: twice 0.01 rad/s at the end.
    np.testing.assert_allclose(traces["offset"]["customdata"][-1], 1.145916, rtol=1e-6)
    strips = [(t["base"].tolist(), t["x"].tolist(), t["customdata"]) for t in figure["data"] if t["type"] == "bar"]
    assert strips == [
        ([0.0], [2.0], ["yes (learning)"]),
        ([2.0], [1.0], ["no: turning"]),
        ([3.0], [1.0], ["invalid: stale"]),
    ]
    assert [shape["x0"] for shape in figure["layout"]["shapes"]] == [3.0]
    assert figure["layout"]["xaxis"]["range"] == [0.0, 3.0]


def test_one_spike_in_an_hour_is_drawn() -> None:
    samples, _ = full_run(360_000)
    samples["speed_mps"][123_457] = 100.0
    figure = drive_figure(samples, None)
    assert figure is not None
    speed = next(trace for trace in figure["data"] if trace["name"] == "speed")
    assert len(speed["x"]) < 5000
    # 100 m/s = 360 km/h; row 123457 at 100 Hz.
    peak = int(np.nanargmax(speed["y"]))
    np.testing.assert_allclose([speed["x"][peak], speed["y"][peak]], [1234.57, 360.0], rtol=1e-6)


def test_counts_are_all_told(tmp_path: Path) -> None:
    counts = {
        "frames": 1234567,
        "gaps": 0,
        "unknown_ids": {f"0x{i:03X}": i for i in range(100, 120)},
        "roles": {"gyro_z": {"samples": 10, "short": 0}, "brake": {"samples": 7, "flagged": 2}},
    }
    found = page(tmp_path, small_run(), {"counts": counts, "median_age_s": {"gyro_z": 0.004, "odd": 0.02}})
    narrow = "\N{NARROW NO-BREAK SPACE}"
    assert f"frames1{narrow}234{narrow}567" in found.text
    assert "None of: gaps." in found.text
    # The 12 largest of 20 ids, and 100 + .. + 107 = 828 for the rest.
    assert "unknown ids › 8 others828" in found.text
    assert ["", "samples", "short", "flagged", "median age, ms"] in found.rows
    assert ["gyro_z", "10", "0", "–", "4.0"] in found.rows
    assert ["brake", "7", "–", "2", "–"] in found.rows
    assert "odd20.0 ms" in found.text


def test_a_strange_summary_is_survived(tmp_path: Path) -> None:
    strange = {"channels": None, "counts": [1], "warnings": "one", "notes": None, "median_age_s": {"a": None}}
    assert "one" in page(tmp_path, small_run(), strange).text


def test_a_folder_that_cannot_be_written_is_a_machine_error(tmp_path: Path) -> None:
    with pytest.raises(MachineError, match=r"report\.html: can't write the report: No such file"):
        write_report({}, {}, tmp_path / "nowhere" / "report.html")


def test_without_plotly_the_message_names_the_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "plotly.offline", None)
    with pytest.raises(MachineError, match=r"pip install dsz-daemon\[desk\]"):
        write_report({}, {}, tmp_path / "report.html")


def test_a_script_cannot_end_itself() -> None:
    with pytest.raises(ValueError, match="end tag"):
        script("let a = '</SCRIPT>';")


def test_data_cannot_end_its_script_either() -> None:
    text = data_block("data-x", json.dumps({"a": "</script>"})).text or ""
    assert "<" not in text
    assert json.loads(text) == {"a": "</script>"}


def test_a_figure_is_what_plotlys_classes_make_of_it() -> None:
    """Columns by their bytes, what is not finite as nothing, and no number that plotly.js does not know."""
    column = np.array([0.5, np.nan, -2.0])
    figure = {
        "data": [
            {
                "type": "scatter",
                "x": column,
                "y": column.astype(np.float32),
                "customdata": np.arange(6.0).reshape(3, 2),
            },
            {"type": "scatter", "x": np.array([1, 2**40]), "y": [1.0, math.inf], "text": np.array(["a", "b"])},
            {"type": "scatter", "x": (np.float32(0.5), np.int64(3)), "y": np.array([True, False])},
        ],
        "layout": {"xaxis": {"range": [0.0, math.nan]}, "showlegend": False},
    }
    mine = json.loads(figure_json(figure))
    for trace, name, values in ((0, "x", column), (0, "y", column)):
        typed = mine["data"][trace][name]
        assert typed["dtype"] == {"x": "f8", "y": "f4"}[name]
        np.testing.assert_array_equal(np.frombuffer(base64.b64decode(typed["bdata"]), f"<{typed['dtype']}"), values)
    # What is in the page else is what plotly's encoder writes.
    checked = json.loads(importlib.import_module("plotly.io").to_json(figure, validate=False, engine="json"))
    for part in mine["data"][0], checked["data"][0]:
        del part["x"], part["y"]
    assert mine == checked
    swapped = column.astype(">f8")
    assert json.loads(figure_json({"data": [{"x": swapped}]})) == json.loads(figure_json({"data": [{"x": column}]}))
