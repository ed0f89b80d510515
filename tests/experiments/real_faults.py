"""What `dsz diagnose` says of a real recording into which one fault was put; Markdown on standard output.

    python tests/experiments/real_faults.py

The RAV4 with the windscreen phone's IMU (60 s). What is said of it without any fault comes first; with one, the fault
is to be named beside that, or its channel is to be said not to be explained. Needs the recordings beside the project.
"""

from __future__ import annotations

import struct
import sys
import tempfile
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import cantools
import yaml

from dsz_daemon.errors import DszError
from dsz_daemon.runs.diagnose import diagnose

ROOT = Path(__file__).parents[2]
DATA = ROOT.parent / "shared" / "data" / "rav4_highway"
CONFIG = ROOT / "tests" / "real" / "rav4_phone.yaml"
GYRO, ACCEL, WHEELS = "601", "602", "0AA"

# Stamp, channel, id, payload.
Frame = tuple[float, str, str, bytes]
Put = Callable[[list[Frame]], list[Frame]]


def read(path: Path) -> list[Frame]:
    """All frames of a candump log."""
    frames = []
    for line in path.read_text().splitlines():
        stamp, channel, frame = line.split()[:3]
        can_id, _, data = frame.partition("#")
        frames.append((float(stamp.strip("()")), channel, can_id, bytes.fromhex(data)))
    return frames


def three(can_id: str, changed: Callable[[float, list[int]], list[float]]) -> Put:
    """The three numbers of one of the phone's messages, in counts, by time since the first frame."""

    def put(frames: list[Frame]) -> list[Frame]:
        first = frames[0][0]
        found = []
        for stamp, channel, one, data in frames:
            if one == can_id and channel == "can1":
                counts = changed(stamp - first, list(struct.unpack("<3h", data)))
                data = struct.pack("<3h", *(max(-32768, min(32767, round(count))) for count in counts))  # noqa: PLW2901
            found.append((stamp, channel, one, data))
        return found

    return put


def late(by_s: float, channel: str, ids: tuple[str, ...]) -> Put:
    """Frames that come later than they did."""

    def put(frames: list[Frame]) -> list[Frame]:
        return sorted((t + by_s if c == channel and i in ids else t, c, i, data) for t, c, i, data in frames)

    return put


def smaller_wheel(frames: list[Frame]) -> list[Frame]:
    """Rear left shows 2 % more."""
    message = cantools.database.load_file(DATA / "toyota_2017.dbc", strict=False).get_message_by_name("WHEEL_SPEEDS")
    found = []
    for stamp, channel, can_id, data in frames:
        if channel == "can0" and int(can_id, 16) == message.frame_id:
            values: dict[str, Any] = dict(message.decode(data, decode_choices=False))  # type: ignore[arg-type]
            values["WHEEL_SPEED_RL"] *= 1.02
            data = bytes(message.encode(values, strict=False))  # noqa: PLW2901
        found.append((stamp, channel, can_id, data))
    return found


FAULTS: dict[str, tuple[str, Put]] = {
    "none": ("", lambda frames: frames),
    "yaw gyro 10 % too sensitive": ("gyro_scale", three(GYRO, lambda _, c: [c[0], c[1], 1.1 * c[2]])),
    "10 % of the yaw rate in the roll gyro": (
        "gyro_cross_axis",
        three(GYRO, lambda _, c: [c[0] + 0.1 * c[2], c[1], c[2]]),
    ),
    "IMU 0.1 s late": ("imu_delay", late(0.1, "can1", (GYRO, ACCEL))),
    "steering 0.3 s late": ("steering_delay", late(0.3, "can0", ("025",))),
    "accelerometer z drifts by 0.01 m/s2 a second": (
        "bias_drift",
        three(ACCEL, lambda t, c: [c[0], c[1], c[2] + 10.0 * t]),
    ),
    "accelerometers clip at 1 m/s2": (
        "sensor_saturation",
        three(ACCEL, lambda _, c: [max(-1000, min(1000, c[0])), max(-1000, min(1000, c[1])), c[2]]),
    ),
    "accelerometer y the wrong way round": ("axis_fault", three(ACCEL, lambda _, c: [c[0], -c[1], c[2]])),
    "rear left wheel 2 % smaller": ("wheel_radius", smaller_wheel),
    "a bit of the yaw gyro stuck": ("", three(GYRO, lambda _, c: [c[0], c[1], c[2] | 0x100])),
    "bytes of the yaw gyro swapped": (
        "",
        three(GYRO, lambda _, c: [c[0], c[1], struct.unpack(">h", struct.pack("<h", c[2]))[0]]),
    ),
}  # fmt: skip


def swapped(signals: dict[str, Any], axle: str) -> None:
    """Left and right of an axle are taken for each other."""
    left, right = f"wheel_speed_{axle}l", f"wheel_speed_{axle}r"
    signals[left], signals[right] = signals[right], signals[left]


def wheels_in_mps(signals: dict[str, Any]) -> None:
    """The configuration takes km/h for m/s."""
    for name in ("fl", "fr", "rl", "rr"):
        signals[f"wheel_speed_{name}"]["unit"] = "m/s"


# What is wrong in the configuration, not in the payloads.
MAPPED: dict[str, Callable[[dict[str, Any]], object]] = {
    "steering the wrong way round": lambda signals: signals["steering_wheel_angle"].update(sign=-1),
    "degrees of the steering taken for radians": lambda signals: signals["steering_wheel_angle"].update(unit="rad"),
    "front wheels on each other's side": lambda signals: swapped(signals, "f"),
    "km/h of all wheels taken for m/s": wheels_in_mps,
}
FAULTS |= {fault: ("axis_fault", lambda frames: frames) for fault in MAPPED}


def mapped(fault: str, folder: Path) -> Path:
    """The configuration, with its fault if it has one."""
    document = yaml.safe_load(CONFIG.read_text())
    document["signals"]["dbc"] = [str((CONFIG.parent / path).resolve()) for path in document["signals"]["dbc"]]
    MAPPED.get(fault, lambda _: None)(document["signals"])
    config = folder / "config.yaml"
    config.write_text(yaml.safe_dump(document))
    return config


def said(fault: str) -> tuple[list[str], list[str], str, dict[str, float]]:
    """Causes, shapes, the verdict, levels beyond three."""
    with tempfile.TemporaryDirectory() as name:
        log = Path(name) / "recording.log"
        frames = FAULTS[fault][1](read(DATA / "recording.log"))
        log.write_text("".join(f"({t:.6f}) {c} {i}#{data.hex().upper()}\n" for t, c, i, data in frames))
        try:
            found = diagnose([log], mapped(fault, Path(name)), Path(name) / "out", draws=False)
        except DszError as error:
            return [], [], str(error).replace(name, ""), {}
    shapes = [f"{shape['channel']} {shape['shape']}" for shape in found["unlisted"]]
    level = {channel: value for channel, value in found["level"].items() if value > 3.0}
    return [cause["effect"] for cause in found["causes"]], shapes, found["verdict"], level


def main() -> None:
    """Prints the table."""
    if not DATA.is_dir():
        sys.exit(f"the real recordings are not beside the project ({DATA.parent.name}/{DATA.name})")
    print("| fault | is to be named | said | verdict | not explained |\n|---|---|---|---|---|")
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        for fault, (causes, shapes, verdict, level) in zip(FAULTS, pool.map(said, FAULTS), strict=True):
            wanted = FAULTS[fault][0]
            told = ", ".join([f"**{cause}**" if cause == wanted else cause for cause in causes] + shapes) or "-"
            off = ", ".join(f"{channel} {value:.0f}" for channel, value in level.items()) or "-"
            print(f"| {fault} | {wanted or '-'} | {told} | {verdict} | {off} |", flush=True)


if __name__ == "__main__":
    main()
