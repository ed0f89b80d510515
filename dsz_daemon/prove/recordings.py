"""A trial as files: the recording with its configuration in one folder, the truth in another."""

from __future__ import annotations

import gzip
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from dsz_daemon.edge.log_writer import CandumpWriter
from dsz_daemon.edge.scenario_files import CONFIG, RECORDING
from dsz_daemon.prove import own_car, third_party_car
from dsz_daemon.prove.mix import AS_PUBLISHED, OWN, SECONDS, Trial, as_truth
from dsz_daemon.prove.unlisted import with_unlisted
from dsz_daemon.prove.ways import car, way
from dsz_daemon.sim.drive import Columns
from dsz_daemon.sim.effects import Choice, described
from dsz_daemon.sim.scenario import SimulatedDrive
from dsz_daemon.sim.sensors import SensorErrors

# Offsets as data sheets of cheap sensors have them; flicker that is as large as the white noise at some 0.1 Hz.
_GYRO_OFFSET_RADPS, _ACCEL_OFFSET_MPS2 = 0.012, 0.12
_GYRO_FLICKER_RADPS, _ACCEL_FLICKER_MPS2 = 1.5e-4, 1e-3
# Profiles of road and air are sealed ten times a second.
_EVERY_S = 0.1
PACKED = f"{RECORDING}.gz"
_PROFILES = ("road_bank_rad", "road_grade_up_rad", "side_wind_n")


def made(trial: Trial, recording: Path) -> tuple[dict[str, Any], dict[str, NDArray[np.float64]]]:
    """Writes recording.log.gz, config.yaml and the DBCs into `recording`; returns the truth, and profiles over time."""
    drive = _driven(trial)
    _write(drive, recording)
    truth = as_truth(trial)
    truth["effects"] = _with_rms(described(trial.effects), drive.truth)
    time_s = drive.truth["time_s"]
    at = np.arange(0.0, float(time_s[-1]), _EVERY_S)
    kept = ("speed_mps", *_PROFILES)
    profiles = {name: np.interp(at, time_s, drive.truth[name]) for name in kept if name in drive.truth}
    return truth, {"time_s": at} | profiles


def _driven(trial: Trial) -> SimulatedDrive:
    rng = np.random.default_rng([trial.seed, 3])
    errors = _errors(rng, trial)

    def changed(columns: Columns) -> Columns:
        for name, size, exponent in trial.unlisted:
            columns = with_unlisted(columns, name, size, exponent)
        return columns

    if trial.car == OWN:
        there = (*trial.effects, *trial.mild, *_stiffness(trial))
        return own_car.simulated(car(rng), way(rng, trial.kind, SECONDS), trial.seed, SECONDS, there, errors, changed)
    there_way = way(rng, trial.kind, SECONDS, may_stand=False)
    published = trial.group == AS_PUBLISHED
    return third_party_car.simulated(there_way, trial.seed, SECONDS, trial.effects, errors, changed, published)


def _stiffness(trial: Trial) -> tuple[Choice, ...]:
    front, rear = trial.stiffness
    if (front, rear) == (1.0, 1.0):
        return ()
    return (Choice("cornering_stiffness", {"front_scale": front, "rear_scale": rear}),)


def _errors(rng: np.random.Generator, trial: Trial) -> SensorErrors:
    """Offsets and noise; half of the sensors have coloured noise, too."""
    gyro, accel = rng.normal(0.0, _GYRO_OFFSET_RADPS, 3).tolist(), rng.normal(0.0, _ACCEL_OFFSET_MPS2, 3).tolist()
    return SensorErrors(
        gyro_offset_radps=(gyro[0], gyro[1], gyro[2]),
        accel_offset_mps2=(accel[0], accel[1], accel[2]),
        gyro_noise_gain=trial.noise_gain,
        accel_noise_gain=trial.noise_gain,
        gyro_flicker_radps=_GYRO_FLICKER_RADPS if trial.flicker else 0.0,
        accel_flicker_mps2=_ACCEL_FLICKER_MPS2 if trial.flicker else 0.0,
    )


def _write(drive: SimulatedDrive, folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in drive.dbc_files.items():
        (folder / name).write_text(text, encoding="utf-8")
    (folder / CONFIG).write_text(yaml.safe_dump(dict(drive.config), sort_keys=False), encoding="utf-8")
    with CandumpWriter(folder / RECORDING) as recording:
        for frame in drive.frames:
            recording.write(frame)
    # The same drive, the same bytes: no time in the header.
    (folder / PACKED).write_bytes(gzip.compress((folder / RECORDING).read_bytes(), 6, mtime=0))
    (folder / RECORDING).unlink()


def _with_rms(effects: list[dict[str, Any]], columns: Columns) -> list[dict[str, Any]]:
    """A road's rms is that of all of it, a wind's of what was driven."""
    moving, whole = columns["speed_mps"] > 3.0, np.ones(len(columns["speed_mps"]), dtype=np.bool_)
    names = {"road_bank": ("rms_rad", "road_bank_rad"), "road_grade": ("rms_rad", "road_grade_up_rad")}
    names["side_wind"] = ("rms_n", "side_wind_n")
    for effect in effects:
        key, column = names.get(effect["effect"], ("", ""))
        if column in columns:
            at = moving if key == "rms_n" else whole
            effect["parameters"][key] = float(np.sqrt(np.mean(columns[column][at] ** 2)))
    return effects
