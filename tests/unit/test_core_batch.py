"""core/batch: steps over arrays are the same steps, compiled or not."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
from core_cases import DEFAULTS, TUCSON

from dsz_daemon.core import batch
from dsz_daemon.core.parameters import Inputs
from dsz_daemon.core.state import initial_state
from dsz_daemon.core.step import step

DT_S = 0.01


def driven(rows: int = 3000) -> np.ndarray:
    """Standing, speeding up, straight on, weaving; noise, a wheel missing for a while, reverse at the end."""
    rng = np.random.default_rng(11)
    t = DT_S * np.arange(rows)
    speed = np.clip(4.0 * (t - 3.0), 0.0, 20.0)
    weave = np.sin(t) * (t > 20.0)
    inputs = np.full((rows, len(Inputs._fields)), math.nan)
    inputs[:, :3] = rng.normal(0.01, 0.003, (rows, 3))
    inputs[:, 2] += 0.1 * weave
    inputs[:, 3:6] = rng.normal((0.1, -0.1, 9.9), 0.05, (rows, 3))
    inputs[:, 6:10] = speed[:, np.newaxis] + rng.normal(0.0, 0.01, (rows, 4)) * (speed > 0.0)[:, np.newaxis]
    inputs[1000:1200, 7] = math.nan
    inputs[1300:1310, 4] = math.inf
    inputs[:, 10] = 0.02 * weave
    inputs[:, 11] = 0.0
    inputs[2800:, 13] = 1.0
    return inputs


def test_rows_are_what_one_step_after_the_other_says() -> None:
    inputs = driven()
    last, rows = batch.run(TUCSON, DEFAULTS, initial_state(DEFAULTS), inputs, DT_S)
    state = initial_state(DEFAULTS)
    for x, row in zip(inputs.tolist(), rows, strict=True):
        state, output = step(TUCSON, DEFAULTS, state, Inputs(*x), DT_S)
        channels = output.channels
        expected = [
            *(channel.offset for channel in channels),
            *(channel.offset_std for channel in channels),
            *(float(channel.state) for channel in channels),
            *(float(channel.gate) for channel in channels),
            *(float(channel.reason) for channel in channels),
            output.speed_mps,
            output.sideslip_rad,
            output.yaw_rate_model_radps,
            float(output.standstill),
        ]
        np.testing.assert_array_equal(row, expected)
    assert last == state
    # The drive is worth the comparison: all channels learn, for more than one reason they don't.
    assert all(len(set(rows[:, batch.REASON + axis].tolist())) > 1 for axis in range(6))
    assert all(np.any(rows[:, batch.GATE + axis] == 1.0) for axis in range(6))


def test_plain_python_gives_the_same_bytes() -> None:
    """Where numba is missing or kept out, the same loop runs as it stands."""
    code = (
        "import sys; sys.path.insert(0, sys.argv[1]); import test_core_batch as t; from dsz_daemon import compiled;"
        "assert not compiled.IS_COMPILED; rows = t.batch.run(t.TUCSON, t.DEFAULTS, t.initial_state(t.DEFAULTS),"
        " t.driven(1500), t.DT_S)[1]; sys.stdout.buffer.write(rows.tobytes())"
    )
    command = [sys.executable, "-c", code, str(Path(__file__).parent)]
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
    plain = subprocess.run(command, env=environment, capture_output=True, check=True).stdout
    rows = batch.run(TUCSON, DEFAULTS, initial_state(DEFAULTS), driven(1500), DT_S)[1]
    assert plain == rows.tobytes()
