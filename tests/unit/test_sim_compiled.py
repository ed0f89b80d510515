"""The compiled car is the plain one, and what was compiled of older sources is not used."""

from __future__ import annotations

import json
import os
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
columns = drive(TwoTrackCar(car, road), programme, start=rolling(car, 15.0))
json.dump([IS_COMPILED, {name: column[::50].tolist() for name, column in columns.items()}], sys.stdout)
"""


def driven(**environment: str) -> tuple[bool, dict[str, list[float]]]:
    done = subprocess.run(
        [sys.executable, "-c", DRIVE], env={**os.environ, **environment}, capture_output=True, text=True, check=True
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
