"""Checksums, counters and the watch over sensors on real cars: nothing true is refused, what is planted is."""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path

import pytest

from dsz_daemon.edge.log_report import LogReport
from dsz_daemon.edge.logs import read_frames
from dsz_daemon.pipeline.decode import Decoder
from dsz_daemon.pipeline.frames import Frame
from dsz_daemon.pipeline.sensor_watch import SensorWatch
from dsz_daemon.runs.setup import Setup, set_up
from dsz_daemon.signals import WHEEL_SPEEDS
from tests.real.recordings import ABSENT, CARS, DATA, FUSION_LOGS, NO_OPENDBC, ROOT

pytestmark = [
    pytest.mark.real,
    pytest.mark.skipif(ABSENT is not None, reason=ABSENT or ""),
    pytest.mark.skipif(NO_OPENDBC is not None, reason=NO_OPENDBC or ""),
]
RAV4 = DATA / "rav4_highway" / "recording.log"
WITH_CHECKSUM = {"KINEMATICS": 0x24, "STEER_ANGLE_SENSOR": 0x25, "PCM_CRUISE": 0x1D2, "SPEED": 0xB4}


def wanted(setup: Setup, log: Path) -> Iterator[Frame]:
    ids = {can_id for can_id, _ in setup.decoder(setup.encoder()).wanted_ids()}
    return (frame for frame in read_frames([log], LogReport()) if frame.can_id in ids)


def decoded(setup: Setup, frames: Iterable[Frame]) -> Decoder:
    decoder = setup.decoder(setup.encoder())
    for frame in frames:
        decoder.decode(frame)
    return decoder


def watched(setup: Setup, frames: Iterable[Frame]) -> list[tuple[int, str]]:
    """Stamp and role of each wheel speed that is taken for frozen; as the loop does it, without its estimator."""
    decoder, watch, last_ns, found = setup.decoder(setup.encoder()), SensorWatch(setup.settings.watch.limits()), 0, []
    for frame in frames:
        for sample in decoder.decode(frame):
            if sample.t_ns - last_ns > 10**9 * setup.settings.loop.gap_s:
                watch.forget()
            last_ns = sample.t_ns
            if not watch.passed(sample) and sample.role in WHEEL_SPEEDS:
                found.append((sample.t_ns, sample.role))
    return found


def test_every_frame_of_the_rav4_has_its_checksum_right() -> None:
    """Counted by opendbc's own function, and by the decoder."""
    from opendbc.car.toyota.toyotacan import toyota_checksum

    setup = set_up(CARS / "toyota_rav4_2017.yaml")
    frames = list(wanted(setup, RAV4))
    signed = [frame for frame in frames if frame.can_id in WITH_CHECKSUM.values()]
    assert all(frame.data[-1] == toyota_checksum(frame.can_id, None, bytearray(frame.data)) for frame in signed)
    decoder = decoded(setup, frames)
    messages = decoder.counters.messages
    assert {p.message for p in setup.checked.resolved.protections} == set(WITH_CHECKSUM)
    assert sum(messages[name].frames for name in WITH_CHECKSUM) == len(signed) > 14_000
    assert decoder.rejected == 0
    # The wheels' message has none: its last byte agrees no oftener than chance would have it.
    wheels = [f for f in frames if f.can_id == 0xAA]
    right = sum(f.data[-1] == toyota_checksum(f.can_id, None, bytearray(f.data)) for f in wheels)
    assert right < 0.02 * len(wheels)


def test_flipped_bits_in_the_rav4s_frames_are_all_noticed() -> None:
    """Single ones: a sum of bytes always shows them."""
    setup, chance, planted = set_up(CARS / "toyota_rav4_2017.yaml"), random.Random(5), Counter[int]()

    def flipped(frame: Frame) -> Frame:
        if frame.can_id not in WITH_CHECKSUM.values() or chance.random() > 0.1:
            return frame
        data, bit = bytearray(frame.data), chance.randrange(64)
        data[bit // 8] ^= 1 << bit % 8
        planted[frame.can_id] += 1
        return frame._replace(data=bytes(data))

    messages = decoded(setup, map(flipped, wanted(setup, RAV4))).counters.messages
    for name, can_id in WITH_CHECKSUM.items():
        assert messages[name].wrong_checksum == planted[can_id] > 100


@pytest.mark.parametrize("name", FUSION_LOGS)
def test_the_fusions_counters_count(name: str) -> None:
    setup = set_up(CARS / "ford_fusion_2017.yaml")
    decoder = decoded(setup, wanted(setup, DATA / "fusion" / f"{name}.log"))
    assert decoder.counters.messages["Yaw_Data_FD1"].frames > 400
    for protection in setup.checked.resolved.protections:
        seen = decoder.counters.messages[protection.message]
        assert (seen.refused, seen.lost) == (0, 0), protection.message


def test_lost_frames_of_the_fusion_are_counted() -> None:
    """Every tenth yaw rate taken out: each is one lost."""
    setup = set_up(CARS / "ford_fusion_2017.yaml")
    frames = list(wanted(setup, DATA / "fusion" / "nothing.log"))
    yaw_id = setup.checked.resolved.messages["Yaw_Data_FD1"].frame_id
    rates = [frame for frame in frames if frame.can_id == yaw_id]
    taken = {id(frame) for frame in rates[5:-5:10]}
    seen = decoded(setup, (frame for frame in frames if id(frame) not in taken)).counters.messages["Yaw_Data_FD1"]
    assert seen.lost == len(taken) > 90
    assert seen.frames == len(rates) - len(taken)
    assert seen.refused == 0


CAR_AND_LOG = [
    (CARS / "toyota_rav4_2017.yaml", "rav4_highway/recording"),
    (ROOT / "tests" / "real" / "rav4_phone.yaml", "rav4_highway/recording"),
    (CARS / "ford_mustang_s550.yaml", "mustang/recording"),
    *((CARS / "ford_fusion_2017.yaml", f"fusion/{name}") for name in FUSION_LOGS),
]


@pytest.mark.parametrize(("config", "log"), CAR_AND_LOG, ids=[f"{c.stem} {log}" for c, log in CAR_AND_LOG])
def test_no_real_wheel_is_taken_for_frozen(config: Path, log: str) -> None:
    setup = set_up(config)
    assert watched(setup, wanted(setup, DATA / f"{log}.log")) == []


@pytest.mark.parametrize(
    ("config", "log", "wheels_id", "from_s"),
    [
        ("toyota_rav4_2017.yaml", "rav4_highway/recording", 0xAA, 30.0),
        ("ford_fusion_2017.yaml", "fusion/car_60km", 0x217, 5.0),
        ("ford_fusion_2017.yaml", "fusion/lkast_activated", 0x217, 3.0),
        ("ford_mustang_s550.yaml", "mustang/recording", 0x217, 60.0),
    ],
)
def test_real_wheels_that_are_made_to_freeze_are_refused_within_two_seconds(
    config: str, log: str, wheels_id: int, from_s: float
) -> None:
    setup = set_up(CARS / config)
    frames = list(wanted(setup, DATA / f"{log}.log"))
    start_ns = frames[0].t_ns + round(from_s * 1e9)
    last = next(frame for frame in reversed(frames) if frame.can_id == wheels_id and frame.t_ns < start_ns)
    frozen = [f._replace(data=last.data) if f.can_id == wheels_id and f.t_ns >= start_ns else f for f in frames]
    refused = watched(setup, frozen)
    assert 0.9e9 < refused[0][0] - start_ns < 2.0e9
    assert {role for _, role in refused} == set(WHEEL_SPEEDS)
