"""What a user holds beside a recording, or gives in a wrong order, is said; nothing is dropped without a word."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest

from dsz_daemon import diagnose as api
from dsz_daemon.cli import main
from dsz_daemon.diagnose import SENSORS, Effect, Parameter
from dsz_daemon.diagnose.simulation.own_effects import require_sound
from dsz_daemon.diagnose.verdict.said import Diagnosis
from dsz_daemon.edge.log_report import LogReport
from dsz_daemon.errors import InputError
from dsz_daemon.pipeline.grid import Signal
from dsz_daemon.runs.diagnose import signals_of
from dsz_daemon.runs.setup import Setup, set_up
from dsz_daemon.runs.simulate import simulate
from dsz_daemon.runs.states_file import read_states


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A drive with an arm of 0.5 m, and its truth."""
    made = tmp_path_factory.mktemp("drive")
    simulate("sine_steer", made, 5, None, ["imu_lever_arm:x_m=0.5,y_m=0,z_m=0"], from_nominal=True)
    return made


@pytest.fixture(scope="module")
def setup(folder: Path) -> Setup:
    return set_up(folder / "config.yaml")


@pytest.fixture(scope="module")
def signals(folder: Path, setup: Setup) -> dict[str, Signal]:
    return signals_of(setup, [folder / "recording.log"], LogReport())


@pytest.fixture(scope="module")
def truth(folder: Path) -> Mapping[str, Signal]:
    """As a reference has it."""
    known = read_states(folder / "truth.parquet").signals
    speed, slides = known["speed_mps"], known["sideslip_rad"].values
    return {
        "vx_mps": Signal(speed.t_ns, speed.values * np.cos(slides)),
        "vy_mps": Signal(speed.t_ns, speed.values * np.sin(slides)),
        "yaw_rate_radps": known["gyro_z"],
        "ay_mps2": known["accel_y"],
        "roll_rad": known["roll_rad"],
    }


def said(setup: Setup, signals: Mapping[str, Signal], **beside: Mapping[str, Signal]) -> Diagnosis:
    vehicle = setup.settings.vehicle
    return api.diagnose(signals, vehicle.car(), vehicle.steering_ratio, **beside).said  # type: ignore[arg-type]


@pytest.mark.parametrize("period_s", [2.0, 1.0, 0.5, 0.2])
def test_a_reference_that_comes_seldom_is_held_against_where_it_is(
    setup: Setup, signals: dict[str, Signal], truth: Mapping[str, Signal], period_s: float
) -> None:
    """Between two samples of a second a line is no motion of a car."""
    of = {}
    for name in ("vx_mps", "vy_mps", "yaw_rate_radps"):
        signal = truth[name]
        every = round(period_s / (float(np.median(np.diff(signal.t_ns))) * 1e-9))
        of[name] = Signal(signal.t_ns[::every], signal.values[::every])
    found = said(setup, signals, reference=of)
    assert [cause.effect for cause in found.causes] == ["imu_lever_arm"]
    assert (found.verdict, found.unlisted) == ("explained", [])
    assert all(level < 3.0 for level in found.level.values())
    assert {"reference_vx_mps", "reference_yaw_rate_radps"} <= set(found.level)


def scaled(factor: float) -> Callable[[Signal], Signal]:
    return lambda signal: Signal(signal.t_ns, factor * signal.values)


def later(by_s: float) -> Callable[[Signal], Signal]:
    return lambda signal: Signal(signal.t_ns + round(by_s * 1e9), signal.values)


@pytest.mark.parametrize(
    ("name", "change", "told"),
    [
        ("vx_mps", scaled(3.6), "vx_mps is 3.6 times the wheels' speed (km/h?)"),
        ("vx_mps", scaled(2.237), "(mph?)"),
        ("vx_mps", scaled(-1.0), "vx_mps is -1 times the wheels' speed;"),
        ("yaw_rate_radps", scaled(57.2958), "times the yaw gyro (deg/s?)"),
        ("yaw_rate_radps", scaled(-1.0), "yaw_rate_radps has another sign than the yaw gyro"),
        ("yaw_rate_radps", later(2.0), "yaw_rate_radps is 2.0 s behind the yaw gyro"),
        ("yaw_rate_radps", later(-1.0), "yaw_rate_radps is 1.0 s ahead of the yaw gyro"),
        ("yaw_rate_radps", scaled(0.0), "yaw_rate_radps stands still beside the yaw gyro"),
    ],
)
def test_a_reference_of_another_unit_sign_or_clock_is_refused(
    setup: Setup,
    signals: dict[str, Signal],
    truth: Mapping[str, Signal],
    name: str,
    change: Callable[[Signal], Signal],
    told: str,
) -> None:
    """It would be one more thing to explain, and all that is there would be explained less."""
    states = {one: truth[one] for one in ("vx_mps", "yaw_rate_radps")}
    with pytest.raises(InputError) as error:
        said(setup, signals, reference={**states, name: change(states[name])})
    assert told in str(error.value)
    assert str(error.value).count("reference") == 1


def test_all_that_is_wrong_with_a_reference_is_told_at_once(
    setup: Setup, signals: dict[str, Signal], truth: Mapping[str, Signal]
) -> None:
    states = {"vx_mps": scaled(3.6)(truth["vx_mps"]), "yaw_rate_radps": scaled(-1.0)(truth["yaw_rate_radps"])}
    with pytest.raises(InputError, match=r"vx_mps is 3\.6 times.*; reference yaw_rate_radps has another sign"):
        said(setup, signals, reference=states)


def test_a_simulation_of_a_few_seconds_agrees_with_nothing(
    setup: Setup, signals: dict[str, Signal], truth: Mapping[str, Signal]
) -> None:
    begin_ns = int(truth["yaw_rate_radps"].t_ns[0]) + 30_000_000_000
    part = {}
    for name in ("yaw_rate_radps", "ay_mps2"):
        inside = (truth[name].t_ns > begin_ns) & (truth[name].t_ns < begin_ns + 7_000_000_000)
        part[name] = Signal(truth[name].t_ns[inside], truth[name].values[inside])
    with pytest.raises(InputError, match=r"the simulation is there for [67]\.\d s of driving .* expected 20 s or more"):
        said(setup, signals, simulation=part)


def run(folder: Path, out: Path, *more: str, logs: tuple[Path, ...] = ()) -> int:
    logs = logs or (folder / "recording.log",)
    return main(["diagnose", *map(str, logs), "-c", str(folder / "config.yaml"), "-o", str(out), *more])


def test_columns_that_are_not_used_are_told(
    folder: Path, truth: Mapping[str, Signal], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    at_s, vx, roll = (truth["vx_mps"].t_ns * 1e-9, truth["vx_mps"].values, truth["roll_rad"].values)
    rows = "\n".join(f"{t:.3f},{v:.4f},{r:.5f},0" for t, v, r in zip(at_s, vx, roll, strict=True))
    (tmp_path / "r.csv").write_text(f"time_s,vx_mps,roll_rad,yawrate\n{rows}\n")
    assert run(folder, tmp_path / "o", "--reference", str(tmp_path / "r.csv")) == 0
    told = "r.csv: not used: roll_rad, yawrate"
    assert f"warning: {told}" in capsys.readouterr().err
    assert told in json.loads((tmp_path / "o/diagnosis.json").read_text())["source"]["warnings"]


def test_logs_in_another_order_are_told(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    frames = (folder / "recording.log").read_text().splitlines()
    middle = len(frames) // 2
    pieces = (tmp_path / "a.log", tmp_path / "b.log")
    for path, part in zip(pieces, (frames[:middle], frames[middle:]), strict=True):
        path.write_text("\n".join(part) + "\n")
    assert run(folder, tmp_path / "right", logs=pieces) == 0
    assert capsys.readouterr().err == ""
    assert run(folder, tmp_path / "wrong", logs=(pieces[1], pieces[0])) == 0
    told = capsys.readouterr().err
    assert "warning: gyro_z: " in told
    assert "samples left out, whose stamps are before those of earlier ones" in told


def test_values_that_are_refused_are_told(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = (folder / "config.yaml").read_text()
    at = text.index("steering_wheel_angle:")
    (tmp_path / "c.yaml").write_text(text[:at] + text[at:].replace("unit: deg", "unit: rad", 1))
    for dbc in folder.glob("*.dbc"):
        (tmp_path / dbc.name).write_bytes(dbc.read_bytes())
    if text == (tmp_path / "c.yaml").read_text():
        pytest.fail("the shipped configuration has its steering in another unit than degrees")
    (tmp_path / "config.yaml").write_text((tmp_path / "c.yaml").read_text())
    run(tmp_path, tmp_path / "o", logs=(folder / "recording.log",))
    told = capsys.readouterr().err
    assert "warning: steering_wheel_angle: " in told
    assert "values refused (short 0, flagged 0, NaN 0, out of range " in told


def test_what_is_not_mapped_is_told_by_the_configuration(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    import yaml

    config = yaml.safe_load((folder / "config.yaml").read_text())
    del config["signals"]["steering_wheel_angle"], config["signals"]["wheel_speed_fl"]
    (tmp_path / "config.yaml").write_text(yaml.safe_dump(config))
    for dbc in folder.glob("*.dbc"):
        (tmp_path / dbc.name).write_bytes(dbc.read_bytes())
    assert run(tmp_path, tmp_path / "o", logs=(folder / "recording.log",)) == 3
    told = capsys.readouterr().err
    assert "config.yaml: signals: wheel_speed_fl, steering_wheel_angle not mapped" in told


def own(**change: object) -> Effect:
    effect = Effect(
        "humming",
        "It hums by {k:.2f}",
        "z += k v",
        SENSORS,
        (Parameter("k", "1/s", 0.1, -1.0, 1.0, 0.01),),
        shows=lambda motion, values: {"accel_z": values["k"] * motion.speed_mps},
    )
    return effect._replace(**change)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"shows": lambda m, v: {"acel_z": v["k"] * m.speed_mps}}, "shows 'acel_z'; expected some of gyro_x, gyro_y"),
        ({"shows": lambda m, v: {"accel_z": v["k"] * m.speed_mps[1:]}}, r"shows \(999,\) of accel_z .* \(1000,\)"),
        ({"shows": lambda m, v: {"accel_z": v["q"] * m.speed_mps}}, "shows asks for 'q'; expected its parameters k"),
        ({"words": "It hums by {z:.2f}"}, "ask for 'z'; expected its parameters k"),
    ],
)
def test_an_effect_of_ones_own_that_cant_be_asked_is_told_by_its_name(change: dict[str, object], told: str) -> None:
    require_sound([own()])
    with pytest.raises(ValueError, match=rf"effect 'humming': .*{told}"):
        require_sound([own(**change)])


def test_a_number_that_the_drive_does_not_tell_is_said_to_be_none(setup: Setup, signals: dict[str, Signal]) -> None:
    [cause] = said(setup, signals).causes
    assert cause.effect == "imu_lever_arm"
    assert cause.statement.endswith("(z_m not told by this drive)")


def test_a_reference_that_is_off_has_its_unit(
    setup: Setup, signals: dict[str, Signal], truth: Mapping[str, Signal]
) -> None:
    noisy = {}
    for name, by in (("vx_mps", 0.8), ("yaw_rate_radps", 0.05)):
        swings = by * np.sin(2.0 * np.pi * 0.15 * (truth[name].t_ns - truth[name].t_ns[0]) * 1e-9)
        noisy[name] = Signal(truth[name].t_ns, truth[name].values + swings)
    found = said(setup, signals, reference=noisy)
    units = {shape.channel: shape.coefficient.unit for shape in found.unlisted}
    assert units["reference_yaw_rate_radps"] == "rad/s"
    assert units["reference_vx_mps"] == "m/s"
