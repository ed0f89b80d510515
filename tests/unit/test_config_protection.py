"""The `protection` section: what is read, and every fault with its line."""

# ruff: noqa: E501 - messages and YAML lines stand as they are read

from pathlib import Path

import pytest

from dsz_daemon.config.check import CheckResult, check_configuration
from dsz_daemon.config.settings import LoopSettings
from dsz_daemon.errors import ConfigError
from dsz_daemon.pipeline.protection import Checksum, Counter, E2e, Protection

CAR = """\
VERSION ""
BO_ 36 KINEMATICS: 8 X
 SG_ YAW_RATE : 0|16@1- (0.01,0) [-327|327] "deg/s" X
 SG_ COUNTER : 48|4@1+ (1,0) [0|15] "" X
 SG_ CHECKSUM : 63|8@0+ (1,0) [0|255] "" X
BO_ 37 OTHER: 8 X
 SG_ ALIVE : 48|4@1+ (1,0) [0|15] "" X
"""
# The section begins at line 12.
CONFIG = """\
vehicle:
  mass_kg: 1673
  yaw_inertia_kgm2: 2850
  cg_to_front_axle_m: 1.149
  cg_to_rear_axle_m: 1.491
  front_cornering_stiffness_n_per_rad: 62000
  rear_cornering_stiffness_n_per_rad: 68000
signals:
  dbc: car.dbc
  gyro_z: {message: KINEMATICS, signal: YAW_RATE, unit: deg/s}
protection:
"""


@pytest.fixture
def check(tmp_path: Path):
    def run(*lines: str, config: str = CONFIG) -> CheckResult:
        (tmp_path / "car.dbc").write_text(CAR, encoding="utf-8")
        (tmp_path / "config.yaml").write_text(config + "".join(f"  {line}\n" for line in lines), encoding="utf-8")
        return check_configuration(tmp_path / "config.yaml")

    return run


def faults(check, *lines: str, config: str = CONFIG) -> list[str]:
    with pytest.raises(ConfigError) as caught:
        check(*lines, config=config)
    return [str(fault).removeprefix("config.yaml") for fault in caught.value.faults]


def test_without_the_section_nothing_is_checked(check):
    result = check(config=CONFIG.replace("protection:\n", ""))
    assert result.resolved.protections == ()
    assert result.warnings == ()


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("counter: {signal: COUNTER}", Protection("KINEMATICS", Counter("COUNTER"))),
        ("counter: {signal: COUNTER, last: 14, max_lost: 5}", Protection("KINEMATICS", Counter("COUNTER", 14, 5))),
        ("checksum: {method: toyota}", Protection("KINEMATICS", None, Checksum("toyota"))),
        (
            "counter: {signal: COUNTER}, checksum: {method: xor, signal: CHECKSUM}",
            Protection("KINEMATICS", Counter("COUNTER"), Checksum("xor", "CHECKSUM")),
        ),
        ("e2e: {profile: 2, data_id: 0x40}", Protection("KINEMATICS", e2e=E2e(2, (0x40,)))),
        (
            "e2e: {profile: 2, data_id: [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15]}",
            Protection("KINEMATICS", e2e=E2e(2, tuple(range(16)))),
        ),
        (
            "e2e: {profile: 1, data_id: 0x1234, data_id_mode: nibble, max_lost: 1}",
            Protection("KINEMATICS", e2e=E2e(1, (0x1234,), "nibble", 1)),
        ),
        ("e2e: {profile: 11, data_id: 7, data_id_mode: nibble}", Protection("KINEMATICS", e2e=E2e(11, (7,), "nibble"))),
        ("e2e: {profile: 5, data_id: 0xFFFF}", Protection("KINEMATICS", e2e=E2e(5, (0xFFFF,)))),
    ],
)
def test_what_is_read(check, line, expected):
    result = check(f"KINEMATICS: {{{line}}}")
    assert result.resolved.protections == (expected,)
    assert result.warnings == ()


METHODS = "toyota, honda, crc8_sae_j1850, xor or sum8"
ONE_FAULT = [
    ("KINEMATIC: {checksum: {method: xor}}", ": protection.KINEMATIC: message 'KINEMATIC' is not in car.dbc; did you mean 'KINEMATICS'?"),
    ("KINEMATICS: {counter: {signal: COUNT}}", ": protection.KINEMATICS.counter.signal: message 'KINEMATICS' has no signal 'COUNT'; did you mean 'COUNTER'?"),
    ("KINEMATICS: {checksum: {method: xor, signal: CHECKSM}}", ": protection.KINEMATICS.checksum.signal: message 'KINEMATICS' has no signal 'CHECKSM'; did you mean 'CHECKSUM'?"),
    ("KINEMATICS: {checksum: {method: md5}}", f": protection.KINEMATICS.checksum.method: 'md5' is not a method; expected {METHODS}"),
    ("KINEMATICS: {checksum: {signal: CHECKSUM}}", f": protection.KINEMATICS.checksum.method: is missing; expected {METHODS}"),
    ("KINEMATICS: {checksum: {method: toyota, signal: YAW_RATE}}", ": protection.KINEMATICS.checksum.signal: 'YAW_RATE' is not one whole byte, where toyota has its checksum"),
    ("KINEMATICS: {checksum: {method: honda, signal: CHECKSUM}}", ": protection.KINEMATICS.checksum.signal: 'CHECKSUM' is not the low nibble of a byte, where honda has its checksum"),
    ("KINEMATICS: {counter: {signal: COUNTER, last: 16}}", ": protection.KINEMATICS.counter.last: 16 is no value of 'COUNTER'; expected 1 to 15"),
    ("KINEMATICS: {counter: {signal: COUNTER, max_lost: 15}}", ": protection.KINEMATICS.counter.max_lost: 15 can't be told by 16 counter values; expected 0 to 14"),
    ("KINEMATICS: {counter: {signal: COUNTER, max_lost: -1}}", ": protection.KINEMATICS.counter.max_lost: -1 is not a max lost; expected 0 to 254"),
    ("KINEMATICS: {counter: {sgnal: COUNTER, signal: COUNTER}}", ": protection.KINEMATICS.counter.sgnal: unknown key 'sgnal'; did you mean 'signal'?"),
    ("KINEMATICS: {}", ": protection.KINEMATICS: says nothing; expected counter, checksum or e2e"),
    ("KINEMATICS: {e2e: {profile: 3, data_id: 1}}", ": protection.KINEMATICS.e2e.profile: 3 is not a profile; expected 1, 2, 5 or 11"),
    ("KINEMATICS: {e2e: {profile: 2, data_id: 0x100}}", ": protection.KINEMATICS.e2e.data_id: 0x100 is not a Data ID of profile 2; expected 0 to 0xFF"),
    ("KINEMATICS: {e2e: {profile: 2, data_id: [1, 2]}}", ": protection.KINEMATICS.e2e.data_id: 2 of them; expected one, or 16 (one a counter value) for profile 2"),
    ("KINEMATICS: {e2e: {profile: 1, data_id: [1, 2]}}", ": protection.KINEMATICS.e2e.data_id: 2 of them; expected one for profile 1"),
    ("KINEMATICS: {e2e: {profile: 2, data_id: 1, data_id_mode: low}}", ": protection.KINEMATICS.e2e.data_id_mode: 'low' is not of profile 2; expected no such key"),
    ("KINEMATICS: {e2e: {profile: 11, data_id: 1, data_id_mode: low}}", ": protection.KINEMATICS.e2e.data_id_mode: 'low' is not of profile 11; expected both or nibble"),
    ("KINEMATICS: {e2e: {profile: 2, data_id: 1}, checksum: {method: xor}}", ": protection.KINEMATICS.e2e: is given beside checksum; expected e2e alone, which has a checksum and a counter"),
]  # fmt: skip


@pytest.mark.parametrize(("line", "expected"), ONE_FAULT)
def test_one_fault(check, line, expected):
    assert faults(check, line) == [f":12{expected}"]


def test_a_missing_data_id_is_a_fault(check):
    (fault,) = faults(check, "KINEMATICS: {e2e: {profile: 2}}")
    assert fault.startswith(":12: protection.KINEMATICS.e2e.data_id: is missing; expected")


def test_all_faults_at_once_each_at_its_line(check):
    """Those of one entry don't hide those of another, nor of the vehicle."""
    found = faults(
        check,
        "KINEMATICS:",
        "  counter: {signal: COUNT}",
        "  checksum: {method: honda, signal: CHECKSUM}",
        "OTHER: {checksum: {method: md5}}",
        "NOWHERE: {checksum: {method: xor}}",
        config=CONFIG.replace("mass_kg: 1673", "mass_kg: -1"),
    )
    assert [fault.partition(" is ")[0] for fault in found] == [
        ":2: vehicle.mass_kg: -1",
        ":13: protection.KINEMATICS.counter.signal: message 'KINEMATICS' has no signal 'COUNT'; did you mean 'COUNTER'?",
        ":14: protection.KINEMATICS.checksum.signal: 'CHECKSUM'",
        ":15: protection.OTHER.checksum.method: 'md5'",
        ":16: protection.NOWHERE: message 'NOWHERE'",
    ]


def test_a_message_that_nothing_is_mapped_from_is_a_warning(check):
    result = check("OTHER: {counter: {signal: ALIVE}}")
    assert result.warnings == (
        "config.yaml:12: protection.OTHER: no signal is taken from message 'OTHER': nothing to protect",
    )
    assert result.resolved.protections == ()
    assert faults(check, "OTHER: {counter: {signal: ALIV}}") == [
        ":12: protection.OTHER.counter.signal: message 'OTHER' has no signal 'ALIV'; did you mean 'ALIVE'?"
    ]


@pytest.mark.parametrize("section", ["protection: 5", "protection: [KINEMATICS]", "protection: {KINEMATICS: toyota}"])
def test_a_section_of_another_shape_is_one_fault(check, section):
    config = CONFIG.replace("protection:\n", f"{section}\n")
    (fault,) = faults(check, config=config)
    assert fault.startswith(":11: protection")
    assert "is not a mapping" in fault


def test_an_empty_section_or_entry_is_said(check):
    assert faults(check) == [":11: protection: is empty; expected a mapping of names"]
    (fault,) = faults(check, "KINEMATICS:")
    assert fault.startswith(":12: protection.KINEMATICS: is empty")


def test_bounds_of_the_rate_and_of_the_watch(check):
    config = CONFIG.replace("protection:\n", "loop: {input_rate_limit_hz: 5}\nwatch: {gyro_patience_s: 0}\n")
    assert faults(check, config=config) == [
        ":11: loop.input_rate_limit_hz: 5 is not an input rate limit; expected 10 to 100000 Hz",
        ":12: watch.gyro_patience_s: 0 is not a gyro patience; expected 0.1 to 600 s",
    ]
    assert LoopSettings().input_rate_limit_hz == 2 * 1000  # twice the fastest known IMU message
