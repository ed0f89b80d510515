"""diagnose: what is known before the car moves sideways is known anew only where it may be another."""

from __future__ import annotations

import numpy as np
import pytest
from test_diagnose_choices import CITY_STEER, CITY_V, N, drive

from dsz_daemon.diagnose.effects.vocabulary import BUILT_IN, INDEX
from dsz_daemon.diagnose.residuals.comparison import rows_of, sensitivities
from dsz_daemon.diagnose.simulation import moving
from dsz_daemon.diagnose.simulation.drive import Floats, nothing
from dsz_daemon.diagnose.simulation.prediction import predicted
from dsz_daemon.diagnose.simulation.road import Profiles, flat
from dsz_daemon.diagnose.simulation.rolling import Rolling

I = INDEX["accel_scale.y"]
STEP = BUILT_IN.columns[I][1].step
COURSE = 0.5 + 0.5 * np.sin(0.01 * np.arange(N))


class FeltWith:
    """A road of which one profile is another as soon as an accelerometer's scale is."""

    def __init__(self, profile: str, size: float) -> None:
        self._profile, self._size = profile, size

    def __call__(self, x: Floats) -> Profiles:
        return flat(N)._replace(**{self._profile: self._size * (1.0 + 10.0 * x[I]) * COURSE})

    def and_shown(self, x: Floats) -> tuple[Profiles, Floats | None]:
        return self(x), None

    def changes_with(self, effect: str) -> bool:
        return effect == "accel_scale"

    def changes_with_offset(self, column: int) -> bool:
        return False


@pytest.mark.parametrize(
    ("profile", "size", "by_rolling"), [("grade_rad", 0.05, True), ("grip", 1.5, True), ("side_n", 400.0, False)]
)
def test_another_climb_or_grip_makes_wheels_roll_otherwise_and_a_wind_does_not(
    profile: str, size: float, by_rolling: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    one, x, felt = drive({}, CITY_V, CITY_STEER), nothing(), FeltWith(profile, size)
    x[INDEX["wheel_slip.slip_per_force"]], x[INDEX["wheel_slip.resistance"]] = 0.05, 1.0
    x[INDEX["tyre_saturation.ellipse"]] = 1.0
    rows, base, there = rows_of(one), predicted(one, x, felt(x)), x.copy()
    there[I] += STEP
    expected = (predicted(one, there, felt(there)) - base)[rows.at] / STEP
    before = (predicted(one, there, felt(there), moving.rolls_of(one, x, felt(x))) - base)[rows.at] / STEP
    anew, rolls_of = list[int](), moving.rolls_of

    def counted(*given: object) -> Rolling:
        anew.append(1)
        return rolls_of(*given)  # type: ignore[arg-type]

    monkeypatch.setattr(moving, "rolls_of", counted)
    slopes = sensitivities(one, rows, x, felt(x), base, [I], felt)[:, :, 0]
    np.testing.assert_allclose(slopes[rows.used], expected[rows.used], rtol=1e-9, atol=1e-9)
    # Once for all columns, and once more where it has to be.
    assert len(anew) == 1 + by_rolling
    assert (np.abs(before - expected)[rows.used].max() > 1e-6) == by_rolling
