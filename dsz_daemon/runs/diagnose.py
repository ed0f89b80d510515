"""`dsz diagnose`: the nominal simulation against a recording: what was left out, by name, and how well it fits then."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dsz_daemon.diagnose import search as searching
from dsz_daemon.diagnose.comparison import SLOW_MPS, driven_s, floors, rows_of
from dsz_daemon.diagnose.effects import COLUMNS, EFFECTS, ROAD, columns_of
from dsz_daemon.diagnose.locate import channel_names, located
from dsz_daemon.diagnose.prediction import CHANNELS, drive_of, predicted, with_knots
from dsz_daemon.diagnose.recording import Floats, recorded
from dsz_daemon.diagnose.search import Fit, Search, values_of
from dsz_daemon.diagnose.unlisted import Shape, unlisted
from dsz_daemon.edge.log_report import LogReport
from dsz_daemon.edge.logs import read_frames
from dsz_daemon.edge.samples_file import write_columns
from dsz_daemon.errors import InputError
from dsz_daemon.pipeline.grid import Signal
from dsz_daemon.runs.results import output_folder
from dsz_daemon.runs.setup import Setup, set_up, versions
from dsz_daemon.runs.summary import write_json
from dsz_daemon.signals import GYRO_CHANNELS, IMU_CHANNELS, WHEEL_SPEEDS

Progress = Callable[[int, int], None]

# Of two explanations so close on unseen data, the recording does not choose.
_ALIKE = 3.0
_DESCRIBED = {effect.name: effect for effect in (*EFFECTS, *ROAD)}
_STIFFNESS_SPREADS = 3.0
_LEAST_STIFFNESS = 0.02
_SHORTEST_S = 20.0
# A channel that is off by so many times its noise and the simulation's coarseness is not explained.
_UNEXPLAINED = 3.0
# As the contract has them: true over configured, which is 1 where nothing is left out.
_OVER_CONFIGURED = {("wheel_radius", wheel) for wheel in ("fl", "fr", "rl", "rr")} | {("steering_ratio", "scale")}


def diagnose(
    logs: Sequence[Path],
    config: Path,
    folder: Path,
    progress: Progress | None = None,
    say: Callable[[str], None] | None = None,
) -> dict[str, Any]:
    """Writes diagnosis.json and fit.parquet of one recording (in pieces) into `folder`; returns the diagnosis.

    `say` hears what is being done. InputError: nothing to drive the simulation with (steering, wheel speeds), nothing
    to compare, or too little of it.
    """
    setup = set_up(config)
    output_folder(folder)
    report = LogReport()
    signals = signals_of(setup, logs, report, progress)
    missing = [name for name in WHEEL_SPEEDS if name not in signals]
    if missing:
        raise InputError(f"no samples of {', '.join(missing)}: the simulation is driven by four wheel speeds")
    if not {"steering_wheel_angle", "road_wheel_angle"} & set(signals):
        raise InputError("no samples of a steering angle: the simulation is driven by it")
    if not any(name in signals for name in IMU_CHANNELS):
        raise InputError("no samples of any IMU channel: there is nothing to hold the simulation against")
    vehicle = setup.settings.vehicle
    drive = drive_of(recorded(signals, vehicle.steering_ratio), vehicle.car(), vehicle.steering_ratio)
    rows = rows_of(drive)
    length_s = driven_s(drive, rows)
    if length_s < _SHORTEST_S:
        raise InputError(
            f"{length_s:.1f} s of driving (above {SLOW_MPS:g} m/s, all signals there); "
            f"expected {_SHORTEST_S:g} s or more to fit and to judge"
        )
    found = searching.searched(drive, rows, setup.settings.diagnose.tolerance, say)
    result = _result(setup, found)
    result["source"] = {"recording": [path.name for path in logs], "log": report.summary()}
    write_json(result, folder / "diagnosis.json")
    write_columns(_columns(found, signals), folder / "fit.parquet")
    return result


def words(result: dict[str, Any]) -> str:
    """The diagnosis in some lines."""
    lines = [f"verdict: {result['verdict']}"]
    for cause in result["causes"]:
        lines.append(f"- {cause['statement']} ({cause['effect']}, probability {cause['probability']:.2f})")
        if cause["indistinguishable_from"]:
            lines.append(f"  this recording can't tell it from: {', '.join(cause['indistinguishable_from'])}")
    for error in result["parameter_errors"]:
        found = f"{error['fitted']:.0f} +- {error['std']:.0f}"
        lines.append(f"- {error['parameter']}: configured {error['configured']:.0f}, fits best at {found}")
    lines += [
        f"- {shape['channel']}: {shape['shape']} with k = {shape['coefficient']['value']:.3g} "
        f"{shape['coefficient']['unit']}, for which there is no name"
        for shape in result["unlisted"]
    ]
    off = [f"{name} {value:.0f} times" for name, value in result["level"].items() if value > _UNEXPLAINED]
    if off:
        lines.append(f"- not explained: {', '.join(off)} what noise and the simulation's coarseness leave")
    for place in result["located"][:3]:
        when = f"{place['start_s']:.0f} to {place['end_s']:.0f} s"
        lines.append(f"  {place['channel']}: {when}, {place['share']:.0%} of its excess")
    for channel, fit in result["fit"].items():
        held = fit["held_out"]
        if held["after"] < 0.9 * held["before"]:
            lines.append(f"  {channel}: rms on unseen data {held['before']:.4g} -> {held['after']:.4g} {fit['unit']}")
    if result["could_not_test"]:
        lines.append(f"not excited enough to test: {', '.join(one['effect'] for one in result['could_not_test'])}")
    return "\n".join(lines)


def signals_of(
    setup: Setup, logs: Sequence[Path], report: LogReport, progress: Progress | None = None
) -> dict[str, Signal]:
    """All samples of the mapped roles, stamps not falling; stamps that fall back are left out."""
    decoder = setup.decoder(setup.encoder())
    wanted = {can_id for can_id, _ in decoder.wanted_ids()}
    stamps: dict[str, list[int]] = {}
    values: dict[str, list[float]] = {}
    for frame in read_frames(logs, report, progress, wanted):
        for sample in decoder.decode(frame):
            mine = stamps.setdefault(sample.role, [])
            if not mine or sample.t_ns >= mine[-1]:
                mine.append(sample.t_ns)
                values.setdefault(sample.role, []).append(sample.value)
    if not stamps:
        names = ", ".join(str(path) for path in logs)
        raise InputError(f"{names}: none of the mapped messages is in it; is this the car of {setup.path}?")
    return {role: Signal(np.array(stamps[role], dtype=np.int64), np.array(values[role])) for role in stamps}


def _result(setup: Setup, found: Search) -> dict[str, Any]:
    causes = [cause for effect in found.best.effects if (cause := _cause(found, effect)) is not None]
    causes.sort(key=lambda cause: -cause["gain"])
    shapes = unlisted(found.drive, found.rows, found.best)
    level = _level(found)
    unexplained = [name for name, value in level.items() if value > _UNEXPLAINED]
    return {
        "verdict": _verdict(causes, shapes, unexplained),
        "located": [place._asdict() for place in located(found.drive, found.rows, found.nominal.left, _usual(found))]
        if causes or shapes or unexplained
        else [],
        "causes": causes,
        "parameter_errors": _parameter_errors(setup, found),
        "unlisted": [
            {
                "channel": shape.channel,
                "shape": shape.shape,
                "coefficient": {"value": shape.coefficient, "std": shape.std, "unit": shape.unit},
            }
            for shape in shapes
        ],
        "fit": _fit(found),
        "level": level,
        "could_not_test": _untested(found),
        "offsets": {name: {"value": v, "std": s} for name, (v, s) in values_of(found.best, "").items()},
        "versions": versions(),
        "settings": setup.settings.used(),
    }


def _usual(found: Search) -> Floats:
    """What each channel scatters by where all is explained."""
    n = np.maximum(found.best.sums.counts.sum(axis=0), 1.0)
    rms = np.sqrt(found.best.sums.left.sum(axis=0) / n) * found.best.scatter
    return np.asarray(np.maximum(rms, found.best.scatter), dtype=np.float64)


def _cause(found: Search, effect: str) -> dict[str, Any] | None:
    """One named effect; None where it is too small to be given a name."""
    described = _DESCRIBED[effect]
    least = {p.name: p.least for p in described.parameters if math.isfinite(p.least)}
    values = {name: value for name, value in values_of(found.best, effect).items() if name in least}
    if described in ROAD:
        road = with_knots(found.best.road, found.best.x)
        profile = road.bank_rad if effect == "road_bank" else road.grade_rad
        driven = np.unique(found.rows.at[found.rows.used.any(axis=1)])
        rms = float(np.sqrt(np.mean(profile[driven] ** 2)))
        values = {"rms_rad": (rms, float("nan"))}
    elif not any(abs(value) >= least[name] and abs(value) > 2.0 * std for name, (value, std) in values.items()):
        return None
    units = {p.name: p.unit for p in described.parameters} | {"rms_rad": "rad", "friction_coefficient": "1"}
    if effect == "tyre_saturation":
        [(square, std)] = values.values()
        friction = square**-0.5
        values = {"friction_coefficient": (friction, 0.5 * friction * std / square)}
    if effect == "sensor_bandwidth":
        [(time_constant_s, std)] = values.values()
        cutoff_hz = 1.0 / (2.0 * np.pi * time_constant_s)
        values |= {"cutoff_hz": (cutoff_hz, cutoff_hz * std / time_constant_s)}
        units["cutoff_hz"] = "Hz"
    values = {
        name: (value + 1.0, std) if (effect, name) in _OVER_CONFIGURED else (value, std)
        for name, (value, std) in values.items()
    }
    rivals = [step for step in found.rivals[effect] if step.effect != effect]
    top = next(step.gain for step in found.rivals[effect] if step.effect == effect)
    odds = sum(float(np.exp(min(step.gain - top, 50.0))) for step in rivals)
    return {
        "effect": effect,
        "probability": 1.0 / (1.0 + odds),
        "statement": described.words.format(**{name: value for name, (value, _) in values.items()}),
        "parameters": {n: {"value": v, "std": s, "unit": units[n]} for n, (v, s) in values.items()},
        "equation": described.equation,
        "gain": found.gains[effect],
        "indistinguishable_from": [step.effect for step in rivals if step.gain > top - _ALIKE],
        "next_manoeuvre": None,
    }


def _parameter_errors(setup: Setup, found: Search) -> list[dict[str, Any]]:
    """Configured stiffnesses that fit better otherwise: by more than their spread, and on unseen data."""
    errors = []
    if searching.stiffness_gain(found) < searching.LEAST_GAIN:
        return []
    for name, (share, std) in searching.stiffness_of(found.best).items():
        key = f"{name}_n_per_rad"
        configured = float(getattr(setup.settings.vehicle, key))
        if abs(share) > max(_STIFFNESS_SPREADS * std, _LEAST_STIFFNESS):
            fitted = configured * (1.0 + share)
            errors.append({"parameter": key, "configured": configured, "fitted": fitted, "std": configured * std})
    return errors


def _level(found: Search) -> dict[str, float]:
    """Per channel: what is left (rms) over what noise and the simulation's own coarseness may leave."""
    n = found.best.sums.counts.sum(axis=0)
    rms = np.sqrt(found.best.sums.left.sum(axis=0) / np.maximum(n, 1.0)) * found.best.scatter
    expected = np.hypot(floors(found.drive), found.best.form)
    names = channel_names(found.drive)
    return {name: float(rms[c] / expected[c]) for c, name in enumerate(names) if n[c] > 0 and expected[c] > 0.0}


def _verdict(causes: list[dict[str, Any]], shapes: list[Shape], unexplained: list[str]) -> str:
    if shapes or unexplained:
        return "partly_explained" if causes else "unexplained"
    return "explained" if causes else "consistent"


def _fit(found: Search) -> dict[str, Any]:
    """RMS per channel: nominal with offsets and stiffnesses, and with the causes; on seen and on unseen blocks."""
    floor = floors(found.drive)

    def rms(fit: Fit, unseen: bool) -> Floats:
        n = np.maximum(fit.sums.counts.sum(axis=0), 1.0)
        total = fit.unseen.sum(axis=0) if unseen else fit.sums.left.sum(axis=0) * fit.scatter**2
        return np.asarray(np.sqrt(total / n), dtype=np.float64)

    sides = {
        (side, when): rms(fit, side == "held_out")
        for side in ("train", "held_out")
        for when, fit in (("before", found.nominal), ("after", found.best))
    }
    used = [bool(found.rows.used[:, c].any()) for c in range(len(CHANNELS))]
    return {
        channel: {
            "train": {when: float(sides["train", when][c]) for when in ("before", "after")},
            "held_out": {when: float(sides["held_out", when][c]) for when in ("before", "after")},
            "noise_floor": float(floor[c]),
            "unit": "rad/s" if channel in GYRO_CHANNELS else "m/s^2" if channel in IMU_CHANNELS else "m/s",
        }
        for c, channel in enumerate(channel_names(found.drive))
        if used[c]
    }


def _untested(found: Search) -> list[dict[str, Any]]:
    """Effects of which a plain size would have shown by less than what is asked of a cause."""
    untested = []
    columns = [i for i in range(len(COLUMNS)) if COLUMNS[i][0] and COLUMNS[i][0] not in found.best.effects]
    slopes = searching.slopes_of(found, columns)
    heard = 1.0 / ((found.best.scatter**2 + found.rows.form**2) * found.best.per_row)
    power: list[float] = np.einsum("kcp,c->p", slopes**2, heard).tolist()
    for effect in EFFECTS:
        own = [columns.index(i) for i in columns_of(effect.name) if i in columns]
        steps = [COLUMNS[columns[i]][1].step for i in own]
        shown = [0.5 * step**2 * power[i] for step, i in zip(steps, own, strict=True)]
        if own and max(shown) < searching.LEAST_GAIN:
            name = COLUMNS[columns[own[int(np.argmax(shown))]]][1]
            why = f"even {name.name} of {name.step:g} {name.unit} would show by less than noise does on this drive"
            untested.append({"effect": effect.name, "why": why})
    return untested


def _columns(found: Search, signals: dict[str, Signal]) -> dict[str, Floats]:
    """fit.parquet: a row per step of the simulation; what was measured, the nominal and the fitted simulation."""
    drive, best = found.drive, found.best
    first = min(int(signal.t_ns[0]) for signal in signals.values())
    road = with_knots(best.road, best.x)
    nominal = predicted(drive, found.nominal.x, found.nominal.road)
    fitted = predicted(drive, best.x, best.road)
    columns: dict[str, Floats] = {"time_s": np.asarray(first * 1e-9 + drive.recording.time_s)}
    for c, channel in enumerate(CHANNELS):
        columns[f"{channel}_measured"] = drive.measured[:, c]
        columns[f"{channel}_nominal"] = nominal[:, c]
        columns[f"{channel}_fitted"] = fitted[:, c]
    return columns | {"road_bank_rad": road.bank_rad, "road_grade_up_rad": road.grade_rad}
