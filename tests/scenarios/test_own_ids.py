"""A car that uses the ids that our own messages usually have."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import short_drive as sd
from scenario_results import Called

Dsz = Callable[..., Called]
pytestmark = pytest.mark.usefixtures("without_report")

THERE = "BO_ 784 IMU_RATES"


def car(folder: Path, can_id: int, more_config: str = "", more_dbc: str = "") -> Path:
    """The short drive's configuration, and a DBC in which the IMU's rates have another id."""
    assert THERE in sd.DBC
    (folder / "car.dbc").write_text(sd.DBC.replace(THERE, f"BO_ {can_id} IMU_RATES") + more_dbc)
    (folder / "config.yaml").write_text(sd.CONFIG + more_config)
    return folder / "config.yaml"


def checked(dsz: Dsz, config: Path) -> tuple[int, str]:
    """The first of our own ids, and the warnings."""
    called = dsz("check", config, "--json")
    assert called.code == 0, called.err
    said: dict[str, Any] = json.loads(called.out)
    return said["settings"]["output"]["base_id"], "\n".join(said["warnings"])


@pytest.mark.parametrize("can_id", [0x6CF, 0x6E0, 0x310])
def test_the_usual_ids_where_they_are_free(dsz: Dsz, tmp_path: Path, can_id: int) -> None:
    base_id, warnings = checked(dsz, car(tmp_path, can_id))
    assert base_id == 0x6D0
    assert "output.base_id" not in warnings


def test_others_where_a_mapped_message_has_one_of_them(dsz: Dsz, tmp_path: Path) -> None:
    base_id, warnings = checked(dsz, car(tmp_path, 0x6D1))
    assert base_id == 0x6C0
    assert "from 0x6D0 on, are those of IMU_RATES (0x6D1): our own messages have the ids from 0x6C0 on" in warnings


def test_not_those_of_a_message_that_is_not_mapped(dsz: Dsz, tmp_path: Path) -> None:
    # 0x6CE.
    more = '\nBO_ 1742 OF_SOMEBODY_ELSE: 1 CAR\n SG_ SOMETHING : 0|8@1+ (1,0) [0|0] "" X\n'
    base_id, _ = checked(dsz, car(tmp_path, 0x6D1, more_dbc=more))
    assert base_id == 0x6E0


def test_nor_the_spare_ones(dsz: Dsz, tmp_path: Path) -> None:
    base_id, _ = checked(dsz, car(tmp_path, 0x6D1, "output: {on_conflict: move, spare_base_id: 0x6C0}\n"))
    assert base_id == 0x6E0


def test_ids_that_were_chosen_are_not_changed(dsz: Dsz, tmp_path: Path) -> None:
    called = dsz("check", car(tmp_path, 0x6D1, "output: {base_id: 0x6D0}\n"))
    assert called.code == 2
    assert "output.base_id: 0x6D0 gives our own messages the ids of IMU_RATES (0x6D1)" in called.err


def test_what_the_car_sends_is_read_and_ours_is_sent_elsewhere(dsz: Dsz, tmp_path: Path) -> None:
    config = car(tmp_path, 0x6D1)
    sent = [frame._replace(can_id=0x6D1) if frame.can_id == 0x310 else frame for frame in sd.frames()[:4000]]
    log = tmp_path / "recording.log"
    log.write_text(sd.candump(sent))
    called = dsz("replay", log, "-c", config, "-o", tmp_path / "out", "--json")
    assert called.code == 0, called.err
    assert "gyro_z" in json.loads(called.out)["channels"]
    lines = (tmp_path / "out/compensated.log").read_text().splitlines()
    ours = {int(line.split()[2].split("#")[0], 16) for line in lines}
    assert ours
    assert all(0x6C0 <= one < 0x6D0 for one in ours)
