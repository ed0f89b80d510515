"""`dsz install-service`: what it would write, what it writes, what it leaves alone."""

from __future__ import annotations

import configparser
import os
import re
from pathlib import Path

import pytest

from dsz_daemon.errors import ConfigError
from dsz_daemon.runs import install
from dsz_daemon.runs.install import InstallOptions, planned_files, shown, words
from dsz_daemon.runs.install import install as written
from dsz_daemon.runs.setup import set_up

GOLDEN = Path(__file__).parents[1] / "golden" / "sine_steer" / "config.yaml"
SYSTEMD = Path(__file__).parents[2] / "systemd"


def _texts(options: InstallOptions) -> dict[str, str]:
    return {str(file.path): file.content.decode() for file in planned_files(options)}


def _unit_text(text: str) -> configparser.RawConfigParser:
    """A unit, read by somebody who knows nothing of ours; of repeated keys the last."""
    parser = configparser.RawConfigParser(strict=False, comment_prefixes=("#",), delimiters=("=",))
    parser.optionxform = str  # type: ignore[assignment,method-assign]
    parser.read_string(text)
    return parser


def test_without_write_nothing_is_written_and_all_is_shown(tmp_path: Path) -> None:
    summary = shown(InstallOptions(config=GOLDEN, root=tmp_path))
    assert list(tmp_path.iterdir()) == []
    assert set(summary["files"]) >= {"/etc/systemd/system/dsz.service", "/etc/dsz/config.yaml"}
    assert "Type=notify" in words(summary)


def test_the_unit_starts_this_installation() -> None:
    unit = _unit_text(_texts(InstallOptions(config=GOLDEN))["/etc/systemd/system/dsz.service"])
    command = unit["Service"]["ExecStart"]
    assert command.endswith(" run -c /etc/dsz/config.yaml")
    program = command.removesuffix(" run -c /etc/dsz/config.yaml").split()[0].strip('"')
    assert Path(program).is_absolute()
    assert os.access(program, os.X_OK)


def test_the_configuration_that_is_written_is_the_one_given_and_good(tmp_path: Path) -> None:
    summary = written(InstallOptions(config=GOLDEN, root=tmp_path))
    config = tmp_path / "etc/dsz/config.yaml"
    assert str(config) in summary["written"]
    assert set_up(config, live=True).settings == set_up(GOLDEN, live=True).settings


def test_a_configuration_that_is_there_stays_and_units_are_renewed(tmp_path: Path) -> None:
    options = InstallOptions(config=GOLDEN, root=tmp_path)
    written(options)
    config, unit = tmp_path / "etc/dsz/config.yaml", tmp_path / "etc/systemd/system/dsz.service"
    mine = config.read_text() + "# mine\n"
    config.write_text(mine)
    unit.write_text("old")
    summary = written(options)
    assert str(config) in summary["kept"]
    assert config.read_text() == mine
    assert unit.read_text() != "old"
    assert [path.name for path in unit.parent.iterdir()] == ["dsz.service"]


def test_a_faulty_configuration_is_not_installed(tmp_path: Path) -> None:
    folder = tmp_path / "mine"
    folder.mkdir()
    for path in GOLDEN.parent.iterdir():
        (folder / path.name).write_bytes(path.read_bytes())
    faulty = folder / GOLDEN.name
    faulty.write_text(re.sub(r"mass_kg: .*", "mass_kg: -5", faulty.read_text()))
    with pytest.raises(ConfigError, match="mass_kg"):
        written(InstallOptions(config=faulty, root=tmp_path / "root"))
    assert not (tmp_path / "root").exists()


@pytest.mark.parametrize(
    ("interface", "device"),
    # As `systemd-escape --path /sys/subsystem/net/devices/NAME` has it.
    [
        ("can0", "sys-subsystem-net-devices-can0.device"),
        ("vcan0", "sys-subsystem-net-devices-vcan0.device"),
        ("can0.5", "sys-subsystem-net-devices-can0.5.device"),
        ("usb-can0", r"sys-subsystem-net-devices-usb\x2dcan0.device"),
    ],
)
def test_the_drop_in_binds_to_the_interface_named(interface: str, device: str) -> None:
    text = _texts(InstallOptions(config=GOLDEN, bind=interface))["/etc/systemd/system/dsz.service.d/bindsto.conf"]
    unit = _unit_text(text)
    assert unit["Unit"]["BindsTo"] == unit["Unit"]["After"] == unit["Install"]["WantedBy"] == device
    assert f"Starts when {interface} is there" in text


def test_an_instance_has_its_own_unit_drop_ins_and_configuration() -> None:
    texts = _texts(InstallOptions(config=GOLDEN, instance="rear", bind="can1", realtime=True))
    units = "/etc/systemd/system"
    drop_ins = f"{units}/dsz@rear.service.d"
    expected = {f"{units}/dsz@.service", f"{drop_ins}/bindsto.conf", f"{drop_ins}/realtime.conf", "/etc/dsz/rear.yaml"}
    assert set(texts) >= expected
    assert f"# {drop_ins}/bindsto.conf" in texts[f"{drop_ins}/bindsto.conf"]
    assert "reenable dsz@rear " in texts[f"{drop_ins}/bindsto.conf"]


@pytest.mark.parametrize("name", ["", "a b", "../x", "can0\n", "-can0", "a" * 16, "kän", "50%"])
def test_names_that_can_not_be_are_refused(name: str) -> None:
    for options in (InstallOptions(instance=name), InstallOptions(bind=name)):
        with pytest.raises(ConfigError, match="expected up to 15"):
            planned_files(options)


@pytest.mark.parametrize("name", ["can0.5", "can:0"])
def test_an_instance_must_make_a_user_name_an_interface_need_not(name: str) -> None:
    """systemd's strict user names (User=dsz-%i) have neither dot nor colon; the kernel's interfaces may."""
    with pytest.raises(ConfigError, match="--instance"):
        planned_files(InstallOptions(config=GOLDEN, instance=name))
    planned_files(InstallOptions(config=GOLDEN, bind=name))


def test_template_and_unit_differ_only_in_what_an_instance_has_of_its_own() -> None:
    """The template repeats the unit; what is mended in one must be mended in the other."""

    def lines(name: str) -> list[str]:
        text = (SYSTEMD / name).read_text().partition("[Service]")[2]
        return [line for line in text.splitlines() if line and not line.startswith("#")]

    own = re.compile(r"dsz-%i|dsz/%i\.yaml")
    template = [
        own.sub(lambda found: "dsz" if found[0] == "dsz-%i" else "dsz/config.yaml", line)
        for line in lines("dsz@.service")
    ]
    assert template == lines("dsz.service")


def test_the_command_of_a_unit_is_quoted() -> None:
    assert install.quoted("/opt/dsz/bin/dsz") == "/opt/dsz/bin/dsz"
    # systemd.service(5): spaces want quotes, % and \ are doubled.
    assert install.quoted('/o "x"/1%\\') == '"/o \\"x\\"/1%%\\\\"'
