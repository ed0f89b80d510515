"""`dsz install-service`: units, drop-ins and a configuration for this very installation, shown or written."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dsz_daemon.errors import ConfigError, DszError, MachineError
from dsz_daemon.runs.installed_place import unseen_by_services
from dsz_daemon.runs.setup import set_up
from dsz_daemon.shipped import shipped

UNITS = Path("/etc/systemd/system")
CONFIGURATION = Path("/etc/dsz")

# What the kernel allows for an interface, less what would need quoting in a file or unit name.
_INTERFACE = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.:-]{0,14}")
# It becomes part of a user's name (User=dsz-%i), where systemd allows no more.
_INSTANCE = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_-]{0,14}")
_SCHEMA = "$schema=dsz.schema.json"


@dataclass(frozen=True)
class InstallOptions:
    """What to install. `root` is prefixed to all paths that are written, never to those inside the files.

    `config`: what becomes the configuration, with its DBC files; None: the example. `instance`: for
    dsz@INSTANCE instead of dsz. `bind`: the interface that the service lives and dies with.
    """

    config: Path | None = None
    instance: str | None = None
    bind: str | None = None
    realtime: bool = False
    metrics: bool = False
    root: Path = Path("/")


@dataclass(frozen=True)
class PlannedFile:
    """A file to be installed; `keep`: what is there already is the user's, and stays."""

    path: Path
    content: bytes
    keep: bool = False


def service_name(options: InstallOptions) -> str:
    """The unit to enable, without its suffix: `dsz` or `dsz@can1`."""
    return "dsz" if options.instance is None else f"dsz@{options.instance}"


def planned_files(options: InstallOptions) -> list[PlannedFile]:
    """All files, units first; ConfigError for names that can't be, and for a configuration that `dsz check` refuses."""
    _check_names(options)
    template = "dsz.service" if options.instance is None else "dsz@.service"
    units = [PlannedFile(UNITS / template, _unit(template))]
    drop_ins = UNITS / f"{service_name(options)}.service.d"
    if options.realtime:
        units.append(PlannedFile(drop_ins / "realtime.conf", _shipped_text("dsz.service.d/realtime.conf").encode()))
    if options.bind is not None:
        units.append(PlannedFile(drop_ins / "bindsto.conf", _bound_to(options.bind, service_name(options)).encode()))
    if options.metrics:
        units.append(PlannedFile(UNITS / "dsz-metrics.service", _unit("dsz-metrics.service")))
    return units + _configuration(options)


def _check_names(options: InstallOptions) -> None:
    if options.instance is not None and _INSTANCE.fullmatch(options.instance) is None:
        raise ConfigError(f"--instance {options.instance}: not possible; expected up to 15 letters, digits or _ -")
    if options.bind is not None and _INTERFACE.fullmatch(options.bind) is None:
        raise ConfigError(
            f"--bind {options.bind}: not an interface's name; expected up to 15 letters, digits or _ . : -"
        )


def _unit(name: str) -> bytes:
    """The unit as shipped, starting the `dsz` of this installation."""
    return re.sub(r"(?m)^ExecStart=dsz ", lambda _: f"ExecStart={exec_start()} ", _shipped_text(name)).encode()


def _shipped_text(name: str) -> str:
    return shipped(f"systemd/{name}").read_text(encoding="utf-8")


def _bound_to(interface: str, name: str) -> str:
    """The drop-in for that interface; its comments too, for whoever finds it there, name the interface and the unit."""
    text = _shipped_text("dsz.service.d/bindsto.conf")
    text = text.replace("dsz.service.d", f"{name}.service.d").replace("reenable dsz ", f"reenable {name} ")
    # In one pass: "can0" is in "vcan0" as well.
    return re.sub(
        r"(net-devices-)?\bcan0\b",
        lambda found: found[1] + _escaped(interface) if found[1] else interface,
        text,
    )


def exec_start() -> str:
    """How a unit starts this installation's `dsz`: the script beside its Python, else Python with the module."""
    script = Path(sys.executable).with_name("dsz")
    if os.access(script, os.X_OK):
        return quoted(str(script))
    return f"{quoted(sys.executable)} -m dsz_daemon"


def quoted(word: str) -> str:
    """A word of ExecStart=, as systemd.service(5) and systemd.unit(5) want it.

    >>> quoted("/opt/dsz/bin/dsz"), quoted("/opt/my dsz/100%/dsz")
    ('/opt/dsz/bin/dsz', '"/opt/my dsz/100%%/dsz"')
    """
    if re.fullmatch(r"[\w./+:@~=,-]+", word, re.ASCII):
        return word
    return '"' + word.replace("\\", "\\\\").replace('"', '\\"').replace("%", "%%") + '"'


def _escaped(name: str) -> str:
    # As systemd-escape does it, for the characters that `_INTERFACE` lets through.
    return name.replace("-", r"\x2d")


def _configuration(options: InstallOptions) -> list[PlannedFile]:
    """The configuration beside its DBC files, whose paths are relative to it."""
    source = shipped("config/example.yaml") if options.config is None else options.config
    given = set_up(source, live=True).settings.signals.dbc
    text = source.read_text(encoding="utf-8")
    target = CONFIGURATION / f"{options.instance or 'config'}.yaml"
    if options.config is None:
        text = text.replace(_SCHEMA, f"$schema={shipped('config/dsz.schema.json')}")
        text = text.replace("dsz check example.yaml", f"dsz check {target}")
    copied: dict[str, Path] = {}
    # The longest first: one may be the end of another.
    for name in sorted((name for name in given if not name.startswith("pkg:")), key=len, reverse=True):
        path = source.parent / name
        if copied.setdefault(path.name, path) != path:
            raise ConfigError(
                f"{source}: signals.dbc: {copied[path.name]} and {path} would both become "
                f"{CONFIGURATION / path.name}; expected different names"
            )
        text = text.replace(name, path.name)
    files = [PlannedFile(CONFIGURATION / name, path.read_bytes(), keep=True) for name, path in copied.items()]
    return [PlannedFile(target, text.encode(), keep=True), *files]


def shown(options: InstallOptions) -> dict[str, Any]:
    """The same summary with nothing written: `files` has each text; of DBC files only the size."""
    files = planned_files(options)
    texts = {str(file.path): file.content.decode() for file in files if not _is_dbc(file)}
    sizes = {str(file.path): f"# {len(file.content)} bytes\n" for file in files if _is_dbc(file)}
    return {
        "unit": f"{service_name(options)}.service",
        "files": texts | sizes,
        "warnings": unseen_by_services(),
        "next": ["the same with --write, as root"],
    }


def _is_dbc(file: PlannedFile) -> bool:
    return file.path.suffix.lower() == ".dbc"


def words(summary: Mapping[str, Any]) -> str:
    """The summary of `install` or `shown`, for reading."""
    parts = [f"# ---- {path}\n{text}" for path, text in summary.get("files", {}).items()]
    parts += [f"written  {path}" for path in summary.get("written", ())]
    parts += [f"kept     {path}: it was there, and is yours" for path in summary.get("kept", ())]
    parts += ["next:", *(f"  {step}" for step in summary["next"])]
    return "\n".join(parts)


def install(options: InstallOptions) -> dict[str, Any]:
    """Writes the files; returns what was written, what was kept, what to mind and what to do next.

    A configuration (or DBC) that is there already is never touched. MachineError where the rights are
    missing or a file can't be written.
    """
    files = planned_files(options)
    if options.root == Path("/") and os.geteuid() != 0:
        raise MachineError(
            f"install-service --write: only root may write in {UNITS} and {CONFIGURATION}; expected "
            "`sudo` before it, or no --write to see what it would write"
        )
    written, kept = [], []
    for file in files:
        path = options.root / file.path.relative_to("/")
        if file.keep and path.exists():
            kept.append(str(path))
            continue
        _write(path, file.content)
        written.append(str(path))
    name, config = service_name(options), options.root / config_path(files).relative_to("/")
    return {
        "unit": f"{name}.service",
        "written": written,
        "kept": kept,
        "warnings": [*unseen_by_services(), *_faults(config)],
        "next": _next_steps(options, name, config_path(files)),
    }


def config_path(files: Iterable[PlannedFile]) -> Path:
    """Which of them is the configuration."""
    return next(file.path for file in files if file.path.suffix == ".yaml")


def _write(path: Path, content: bytes) -> None:
    # Beside it first: a unit is there whole or not at all. Read by the service's own user, whatever root's umask is.
    part = path.with_name(f".{path.name}.part")
    try:
        for folder in (*reversed(path.parent.parents), path.parent):
            if not folder.exists():
                folder.mkdir()
                folder.chmod(0o755)
        part.write_bytes(content)
        part.chmod(0o644)
        part.replace(path)
    except OSError as error:
        raise MachineError(f"{path}: not written: {error.strerror}") from error


def _faults(config: Path) -> list[str]:
    """What stands in the way of the configuration that is now there: its own faults, its rights."""
    found = []
    try:
        set_up(config, live=True)
    except DszError as error:
        # One that was there before; a new one was checked where it came from.
        found.append(str(error))
    if not config.stat().st_mode & 0o004:
        found.append(f"{config}: the service's user may not read it; expected `chmod o+r`")
    return found


def _next_steps(options: InstallOptions, name: str, config: Path) -> list[str]:
    steps = []
    if options.config is None:
        steps.append(f"edit {config}: it describes another car, not yours")
        steps.append(f"dsz check {config}")
    if options.realtime:
        steps.append(f"add to {config}: service: {{realtime_priority: 50, lock_memory: true}}")
    steps += ["systemctl daemon-reload", f"systemctl enable --now --no-block {name}"]
    if options.metrics:
        steps.append("systemctl enable --now dsz-metrics")
    socket = "" if options.instance is None else f" --socket /run/dsz-{options.instance}/status.sock"
    return [*steps, f"systemctl status {name}; journalctl -u {name}; dsz status{socket}"]
