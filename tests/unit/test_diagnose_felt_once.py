"""diagnose: what is felt of road and air is simulated once, and an offset that is in none of it is no other road."""

from __future__ import annotations

import numpy as np
import pytest
from test_diagnose_choices import CITY_STEER, CITY_V, T, drive
from test_diagnose_unfelt_banks import banked
from test_diagnose_unfelt_grades import climbing
from test_diagnose_wind import blown_on

from dsz_daemon.diagnose.effects.nuisances import OFFSETS
from dsz_daemon.diagnose.simulation.drive import Drive, nothing
from dsz_daemon.diagnose.simulation.instruments import low_passed
from dsz_daemon.diagnose.simulation.prediction import predicted
from dsz_daemon.diagnose.surroundings import profiles
from dsz_daemon.diagnose.surroundings.profiles import Felt

WITHOUT = [0, 1, 5]
YAW, SIDEWAYS = 2, 4


def felt_in(one: Drive, effects: tuple[str, ...]) -> Felt:
    felt = Felt(one, nothing(), effects)
    return felt.anew() or felt


def gusty(without: list[int]) -> Drive:
    one, _ = blown_on(0.3)
    one.measured[:, without] = np.nan
    return one


@pytest.mark.parametrize(
    ("one", "effects", "others"),
    [
        (climbing({}), ("road_grade",), set()),
        (banked({}), ("road_bank",), {YAW, SIDEWAYS}),
        (banked({}), ("road_bank", "road_grade"), {YAW, SIDEWAYS}),
        (gusty([]), ("side_wind",), {SIDEWAYS}),
        (gusty([]), ("side_wind", "road_grade"), {SIDEWAYS}),
        (gusty(WITHOUT), ("side_wind", "road_bank"), {YAW, SIDEWAYS}),
        (drive({}, CITY_V, CITY_STEER), ("road_bank", "road_grade"), set()),
    ],
)
def test_an_offset_is_another_road_or_wind_where_that_is_taken_from_its_channel(
    one: Drive, effects: tuple[str, ...], others: set[int]
) -> None:
    felt, x = felt_in(one, effects), nothing()
    usual = felt(x)
    for i in range(len(OFFSETS)):
        there = x.copy()
        there[i] += 0.05
        is_same = all(np.array_equal(np.asarray(a), np.asarray(b)) for a, b in zip(usual, felt(there), strict=True))
        assert is_same == (i not in others)
        assert felt.changes_with_offset(i) == (i in others)


def test_a_wind_that_is_another_one_for_other_parameters_hands_on_what_it_was_found_by() -> None:
    one, x = gusty([]), nothing()
    felt = felt_in(one, ("side_wind",))
    known = 0
    for i, step in ((SIDEWAYS, 0.0), (SIDEWAYS, 0.05), (len(OFFSETS), 0.02), (len(OFFSETS) + 1, -0.05)):
        there = x.copy()
        there[i] += step
        road, shown = felt.and_shown(there)
        np.testing.assert_array_equal(road.side_n, felt(there).side_n)
        if shown is not None:
            known += 1
            np.testing.assert_array_equal(shown, predicted(one, there, road))
    assert known


@pytest.mark.parametrize(
    ("one", "effects", "count"),
    [
        (climbing({}), ("road_grade",), 1),
        (banked({}), ("road_bank",), 0),
        (climbing({}, without=()), ("road_grade",), 1),
        (climbing({}, without=(1, 5)), ("road_bank", "road_grade"), 2),
    ],
)
def test_gyros_that_feel_no_road_are_not_asked(
    one: Drive, effects: tuple[str, ...], count: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    felt, there, asked = Felt(one, nothing(), effects), nothing(), list[int]()
    there[len(OFFSETS)] = 0.01

    def counted(*given: object) -> np.ndarray:
        asked.append(1)
        return predicted(*given)  # type: ignore[arg-type]

    monkeypatch.setattr(profiles, "predicted", counted)
    felt(there)
    assert len(asked) == count


@pytest.mark.parametrize("reach", range(1, 10))
def test_the_low_pass_weighs_each_neighbour_once(reach: int) -> None:
    values = np.sin(T) + 0.1 * np.arange(len(T)) % 7
    kernel = 1.0 / (1.0 + np.abs(np.arange(-reach, reach + 1)))
    padded = np.concatenate([np.full(reach, values[0]), values, np.full(reach, values[-1])])
    np.testing.assert_allclose(low_passed(values, kernel), np.convolve(padded, kernel, mode="valid"), rtol=1e-12)
