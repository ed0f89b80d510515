"""The configurations that ship: each fits its DBC, and on real recordings its signs are right."""

import functools
import importlib.util
from collections import defaultdict
from pathlib import Path

import numpy as np
import pytest
import yaml

from dsz_daemon.config.check import CheckResult, check_configuration
from dsz_daemon.config.document import read_document
from dsz_daemon.config.estimator import DoubtSettings
from dsz_daemon.config.settings import DiagnoseSettings, LoopSettings, OutputSettings, ServiceSettings
from dsz_daemon.config.watch import WatchSettings
from dsz_daemon.shipped import shipped

CARS = sorted(path.name for path in (shipped("config") / "cars").glob("*.yaml"))
DATA = Path(__file__).resolve().parents[2].parent / "shared" / "data"

needs_opendbc = pytest.mark.skipif(
    importlib.util.find_spec("opendbc") is None,
    reason="opendbc is not installed (there is none for Python 3.13 and later)",
)


@functools.cache
def checked(name: str) -> CheckResult:
    """One car's configuration; a large DBC takes a second to read."""
    return check_configuration(shipped("config") / "cars" / name)


def test_the_cars_that_the_readme_promises_are_there():
    assert {name.split("_")[0] for name in CARS} == {"hyundai", "toyota", "ford"}


@needs_opendbc
@pytest.mark.parametrize("name", CARS)
def test_a_cars_mapping_fits_its_dbc(name):
    result = checked(name)
    assert result.warnings == ()
    roles = {source.role for source in result.resolved.sources}
    assert {"accel_x", "accel_y", "steering_wheel_angle", "brake"} <= roles
    assert {"wheel_speed_fl", "wheel_speed_fr", "wheel_speed_rl", "wheel_speed_rr"} <= roles


@pytest.mark.parametrize("name", CARS)
def test_a_cars_file_points_editors_to_the_schema(name):
    path = shipped("config") / "cars" / name
    first = path.read_text(encoding="utf-8").splitlines()[0]
    assert (path.parent / first.removeprefix("# yaml-language-server: $schema=")).resolve().name == "dsz.schema.json"
    assert (path.parent / first.removeprefix("# yaml-language-server: $schema=")).is_file()


def test_the_example_is_complete_and_shows_the_defaults():
    result = check_configuration(shipped("config") / "example.yaml")
    assert result.warnings == ()
    assert result.notes == ()
    settings = result.settings
    assert settings.loop == LoopSettings()
    assert settings.output.model_copy(update={"bus": None}) == OutputSettings()
    assert settings.diagnose == DiagnoseSettings()
    assert settings.watch == WatchSettings()
    assert settings.watch.model_fields_set == set(WatchSettings.model_fields)
    assert settings.service == ServiceSettings()
    assert settings.estimator.doubt == DoubtSettings()
    assert {"input_rate_limit_hz", "input_burst_s"} <= settings.loop.model_fields_set


def test_the_examples_protection_is_right_where_its_hash_marks_are_taken_away(tmp_path):
    text = (shipped("config") / "example.yaml").read_text(encoding="utf-8")
    start = text.index("# protection:\n")
    block, _, rest = text[start:].partition("\n\n")
    shown = text[:start] + block.replace("# ", "", 1).replace("\n# ", "\n") + "\n\n" + rest
    (tmp_path / "config.yaml").write_text(shown.replace("../dbc/", f"{shipped('dbc')}/"), encoding="utf-8")
    result = check_configuration(tmp_path / "config.yaml")
    assert result.warnings == ()
    assert [protection.message for protection in result.resolved.protections] == [
        "KINEMATICS", "STEER_ANGLE_SENSOR", "IMU_RATE",
    ]  # fmt: skip


def test_the_example_reads_the_data_sheets_sensors():
    """An ADW22307 at +100 deg/s puts out 2.5 + 0.7 V: by its data sheet, count by count."""
    sources = {s.role: s for s in check_configuration(shipped("config") / "example.yaml").resolved.sources}
    gyro = sources["gyro_x"]
    assert gyro.volts_per_count is not None
    counts = round(3.2 / (5.0 / 65536))
    value = (counts * gyro.volts_per_count - gyro.null_volts) / gyro.volts_per_unit
    assert value == pytest.approx(100.0, abs=0.05)
    assert gyro.sign * gyro.to_si * value == pytest.approx(np.deg2rad(100.0), abs=1e-3)
    # Gravity pulls an axis that points down to -1 g of specific force: 1.5 V. Turned up, that is +g.
    down = sources["accel_z"]
    value = (1.5 - down.null_volts) / down.volts_per_unit
    assert down.sign * down.to_si * value == pytest.approx(9.80665)


def test_shipped_yaml_means_the_same_to_a_yaml_1_1_reader():
    """Other tools read these files with PyYAML's own rules: nothing in them may mean something else there."""
    for path in [shipped("config") / "example.yaml", *(shipped("config") / "cars").glob("*.yaml")]:
        assert yaml.safe_load(path.read_text(encoding="utf-8")) == read_document(path).data


def decoded(result: CheckResult, log: Path) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Times and SI values by role, by cantools alone: a second route, apart from the pipeline's decoder."""
    by_id = defaultdict(list)
    for source in result.resolved.sources:
        by_id[result.resolved.messages[source.message].frame_id].append(source)
    found: dict[str, tuple[list[float], list[float]]] = defaultdict(lambda: ([], []))
    for line in log.read_text().splitlines():
        stamp, channel, frame = line.split()
        can_id, _, data = frame.partition("#")
        if channel == "can1" or int(can_id, 16) not in by_id:
            continue
        for source in by_id[int(can_id, 16)]:
            message = result.resolved.messages[source.message]
            values = message.decode(bytes.fromhex(data), decode_choices=False, allow_truncated=True)
            if all(part.signal in values for part in source.parts):
                total = sum(part.sign * float(values[part.signal]) for part in source.parts)
                found[source.role][0].append(float(stamp[1:-1]))
                found[source.role][1].append(source.sign * source.to_si * total)
    return {role: (np.array(t), np.array(v)) for role, (t, v) in found.items()}


def smooth_on_grid(samples: dict[str, tuple[np.ndarray, np.ndarray]], window: int = 31) -> dict[str, np.ndarray]:
    """All roles on one 100 Hz grid, averaged over `window` points."""
    start = max(t[0] for t, _ in samples.values())
    end = min(t[-1] for t, _ in samples.values())
    grid = np.arange(start, end, 0.01)
    box = np.ones(window) / window
    return {role: np.convolve(np.interp(grid, t, v), box, "valid") for role, (t, v) in samples.items()}


def correlation(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.corrcoef(a, b)[0, 1])


real = pytest.mark.skipif(not DATA.is_dir(), reason="the real recordings are not beside the project")


@real
@pytest.mark.real
@needs_opendbc
def test_the_ravs_signs_are_right_in_motion():
    result = checked("toyota_rav4_2017.yaml")
    car = smooth_on_grid(decoded(result, DATA / "rav4_highway" / "recording.log"), 51)
    speed = 0.5 * (car["wheel_speed_rl"] + car["wheel_speed_rr"])
    yaw = car["gyro_z"] - car["gyro_z"].mean()  # the road is straight on the whole
    assert correlation(car["accel_x"], np.gradient(speed, 0.01)) > 0.7
    assert correlation(car["accel_y"], yaw * speed) > 0.7
    assert correlation(yaw, car["steering_wheel_angle"] * speed) > 0.8
    assert speed.mean() == pytest.approx(car["speed_reference"].mean(), rel=0.03)


@real
@pytest.mark.real
@needs_opendbc
def test_the_fusions_signs_and_radii_are_right_in_motion():
    result = checked("ford_fusion_2017.yaml")
    brake = smooth_on_grid(decoded(result, DATA / "fusion" / "collision_assist_activated.log"))
    speed = 0.25 * sum(brake[f"wheel_speed_{wheel}"] for wheel in ("fl", "fr", "rl", "rr"))
    acceleration = np.gradient(speed, 0.01)
    assert correlation(brake["accel_x"], acceleration) > 0.98
    # Tyres slip by a few percent in such a stop; a wrong unit would be off by a factor of 9.8.
    assert np.polyfit(acceleration, brake["accel_x"], 1)[0] == pytest.approx(1.0, abs=0.1)
    assert brake["accel_x"][brake["brake"] > 0].mean() < -3.0
    assert correlation(brake["accel_y"], brake["gyro_z"] * speed) > 0.9
    assert correlation(brake["gyro_x"], brake["roll_rate_reference"]) > 0.9
    assert brake["accel_z"].mean() == pytest.approx(9.8, abs=0.3)
    lane = smooth_on_grid(decoded(result, DATA / "fusion" / "lkast_activated.log"))
    speed = 0.5 * (lane["wheel_speed_rl"] + lane["wheel_speed_rr"])
    assert speed.mean() == pytest.approx(lane["speed_reference"].mean(), rel=0.005)
    assert correlation(lane["gyro_z"], lane["steering_wheel_angle"]) > 0.9
    assert correlation(lane["gyro_z"], lane["wheel_speed_rr"] - lane["wheel_speed_rl"]) > 0.9
    assert correlation(lane["gyro_z"], lane["yaw_rate_reference"]) > 0.99


@real
@pytest.mark.real
@needs_opendbc
@pytest.mark.parametrize("log", ["car_50km", "car_60km", "amarillo", "lkast_activated", "collision_assist_activated"])
def test_the_fusions_steering_is_near_zero_on_straight_roads(log):
    """Without the car's own zero it would be off by up to 63 deg."""
    result = checked("ford_fusion_2017.yaml")
    steering = np.rad2deg(decoded(result, DATA / "fusion" / f"{log}.log")["steering_wheel_angle"][1])
    assert abs(steering.mean()) < 3.0
    assert np.abs(steering).max() < 6.0


@real
@pytest.mark.real
@needs_opendbc
def test_the_mustangs_signs_are_right_in_motion():
    result = checked("ford_mustang_s550.yaml")
    car = smooth_on_grid(decoded(result, DATA / "mustang" / "recording.log"))
    speed = 0.5 * (car["wheel_speed_fl"] + car["wheel_speed_fr"])
    assert correlation(car["accel_x"], np.gradient(speed, 0.01)) > 0.7
    moving = speed > 5.0
    assert correlation(car["accel_y"][moving], (car["yaw_rate_reference"] * speed)[moving]) > 0.4
    assert correlation(car["steering_wheel_angle"][moving], car["yaw_rate_reference"][moving]) > 0.6
    assert car["accel_z"].mean() == pytest.approx(9.7, abs=0.3)
