"""The compiled car is the plain one, and another Python's, to the byte of the log; older compilations are not used."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from dsz_daemon.compiled import IS_COMPILED

# Two seconds of everything at once: a bend with a bank, a hill and roughness, wind, play, compliance, brakes.
DRIVE = """
import json, sys
from dataclasses import replace
import numpy as np
from dsz_daemon.compiled import IS_COMPILED
from dsz_daemon.sim.car import TUCSON
from dsz_daemon.sim.drive import drive
from dsz_daemon.sim.driver import Programme, SineSteer, SpeedChange
from dsz_daemon.sim.road import tabled_road
from dsz_daemon.sim.vehicle import TwoTrackCar, rolling
car = replace(TUCSON, steering_backlash_rad=2e-3, steering_compliance_rad_per_n=1e-6, front_drive_share=0.6)
rough = 1e-3 * np.random.default_rng(1).normal(size=(2, 201))
road = tabled_road(100.0, lambda s: 0.05 * np.sin(s / 9.0), lambda s: 0.04 * np.cos(s / 7.0),
                   lambda s: 0.01 * np.sin(s / 20.0), (rough[0], rough[1]))
programme = Programme(2.0, (SpeedChange(-2.0, -1.0, 15.0), SpeedChange(0.5, 1.9, -6.0)),
                      (SineSteer(0.2, 1.0, 1, 0.3),), True, lambda t: 200.0 * np.sin(5.0 * t), lambda t: 1.0 - 0.2 * t)
"""
COLUMNS = """
columns = drive(TwoTrackCar(car, road), programme, start=rolling(car, 15.0))
json.dump([IS_COMPILED, {name: column[::50].tolist() for name, column in columns.items()}], sys.stdout)
"""
# The same as `dsz simulate` writes it, with sensors that nobody calibrated.
LOG = """
from pathlib import Path
from dsz_daemon.edge.log_writer import CandumpWriter
from dsz_daemon.sim.catalogue import Scenario
from dsz_daemon.sim.scenario import simulate_scenario
from dsz_daemon.sim.sensor_draws import draw_datasheet_errors
scenario = Scenario("everything at once", car, road, programme, 15.0)
errors = draw_datasheet_errors(np.random.default_rng(5))
with CandumpWriter(Path(sys.argv[1])) as log:
    for frame in simulate_scenario("everything", scenario, 5, errors).frames:
        log.write(frame)
print(IS_COMPILED)
"""
ROOT = Path(__file__).parents[2]


def driven(**environment: str) -> tuple[bool, dict[str, list[float]]]:
    done = subprocess.run(
        [sys.executable, "-c", DRIVE + COLUMNS],
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=True,
    )
    is_compiled, columns = json.loads(done.stdout)
    return is_compiled, columns


@pytest.mark.skipif(not IS_COMPILED, reason="numba is not installed, or kept out")
def test_plain_python_drives_the_same_way() -> None:
    is_compiled, compiled = driven()
    is_plain_compiled, plain = driven(NUMBA_DISABLE_JIT="1")
    assert (is_compiled, is_plain_compiled) == (True, False)
    assert compiled.keys() == plain.keys()
    for name, values in plain.items():
        # Compilers may round a sum differently; one count of any sensor is 1e-5 or more.
        assert compiled[name] == pytest.approx(values, rel=1e-9, abs=1e-9), name
    assert max(map(abs, plain["accel_y_mps2"])) > 1.0


def logged(path: Path, python: str = sys.executable, **environment: str) -> tuple[str, bytes]:
    """Whether it was compiled, and the log."""
    around = {**os.environ, "PYTHONPATH": str(ROOT), **environment}
    done = subprocess.run(
        [python, "-c", DRIVE + LOG, str(path)], env=around, cwd=path.parent, capture_output=True, text=True, check=True
    )
    return done.stdout.strip(), path.read_bytes()


@pytest.fixture(scope="module")
def plain_log(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    is_compiled, log = logged(tmp_path_factory.mktemp("plain") / "recording.log", NUMBA_DISABLE_JIT="1")
    assert is_compiled == "False"
    assert log.count(b"\n") > 1000
    return log


@pytest.mark.skipif(not IS_COMPILED, reason="numba is not installed, or kept out")
def test_compiled_and_plain_write_the_same_log(plain_log: bytes, tmp_path: Path) -> None:
    assert logged(tmp_path / "recording.log") == ("True", plain_log)


OTHERS = [f"3.{minor}" for minor in (11, 12, 13) if minor != sys.version_info.minor]


@pytest.mark.parametrize("version", OTHERS)
def test_another_python_writes_the_same_log(version: str, plain_log: bytes, tmp_path: Path) -> None:
    python = shutil.which(f"python{version}")
    if python is None:
        pytest.skip(f"there is no python{version} on the path")
    needs = "import can, cantools, numpy, pydantic, sys; assert '%d.%d' % sys.version_info[:2] == '" + version + "'"
    if subprocess.run([python, "-c", needs], capture_output=True, check=False).returncode:
        pytest.skip(f"python{version} is there, but not what the simulation needs: pip install dsz-daemon for it")
    assert logged(tmp_path / "recording.log", python, NUMBA_DISABLE_JIT="1")[1] == plain_log


@pytest.mark.skipif(not IS_COMPILED, reason="numba is not installed, or kept out")
def test_a_changed_equation_is_compiled_anew_in_its_callers(tmp_path: Path) -> None:
    """Numba itself looks only at the file of the function that is called."""
    package = tmp_path / "dsz_daemon"
    (package / "sim").mkdir(parents=True)
    for name in ("compiled.py", "signals.py", "errors.py", "__init__.py"):
        (package / name).write_bytes((Path(__file__).parents[2] / "dsz_daemon" / name).read_bytes())
    (package / "sim/__init__.py").touch()
    head = "from dsz_daemon.compiled import compiled\n"
    (package / "sim/upper.py").write_text(
        f"{head}from dsz_daemon.sim.lower import lower\n@compiled\ndef upper(x):\n    return 10.0 * lower(x)\n"
    )
    for factor in (2.0, 30.0):  # of another length: Python itself goes by a file's size and second
        (package / "sim/lower.py").write_text(f"{head}@compiled\ndef lower(x):\n    return {factor} * x\n")
        said = subprocess.run(
            [sys.executable, "-c", "from dsz_daemon.sim.upper import upper; print(upper(1.0))"],
            cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(tmp_path)}, capture_output=True, text=True, check=True,
        )  # fmt: skip
        assert float(said.stdout) == 10.0 * factor
    assert len(list((package / "__pycache__").glob("compiled-*"))) == 1
