"""The longer drives of the catalogue, as legs. Radii, grades and banks are those of road design guides, rounded.

Bends of streets and roads, their banking and grades: RAA 2008 and RAL 2012 (the German guides for motorways and country
roads), RASt 06 (streets); a ramp of a car park: up to 15 %, radius inside 5 m and more (garage ordinances).
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from dsz_daemon.sim.journey import Leg

_PER_CENT = 0.01
QUARTER = math.pi / 2.0


def _turn(radius_m: float, angle_rad: float, speed_mps: float, grade: float = 0.0, bank: float = 0.0) -> Leg:
    """A bend through an angle, left positive."""
    return Leg(radius_m * abs(angle_rad), speed_mps, math.copysign(1.0 / radius_m, angle_rad), grade, bank)


def city() -> list[Leg]:
    """Ten minutes of blocks: lights, corners, speeds to 50 km/h, streets that tilt by a per cent or two."""
    rng = np.random.default_rng(1)
    legs: list[Leg] = []
    for block in range(15):
        grade, bank = (rng.uniform(-2.0, 2.0, 2) * _PER_CENT).tolist()
        legs.append(Leg(float(rng.uniform(150.0, 300.0)), 13.0, 0.0, grade, bank))
        if block % 3 == 1:
            legs.append(Leg(80.0, 10.0, 0.0, grade, bank, stop_s=float(rng.uniform(8.0, 25.0))))
        legs.append(Leg(60.0, 6.0, 0.0, grade, bank))
        legs.append(_turn(12.0, QUARTER if rng.uniform() < 0.5 else -QUARTER, 5.0, 0.0, bank / 2.0))
    return [*legs, Leg(150.0, 10.0)]


def highway() -> list[Leg]:
    """Ten minutes at 100 to 125 km/h: bends of 900 m and more, banked by 2.5 to 4 %, grades to 4 %."""
    legs = [Leg(600.0, 28.0, 0.0, 0.0, 2.5 * _PER_CENT)]
    # Radius in m (left positive), length, speed, grade and bank in per cent. Right-hand traffic: straight on, the
    # road falls to the right by 2.5 %.
    for radius_m, length_m, speed_mps, grade, bank in (
        (0, 1500, 30, 1.5, 2.5), (1800, 1200, 30, 1.5, -2.5), (0, 900, 33, 0.0, 2.5), (-1200, 1400, 33, -3.0, 3.5),
        (0, 2200, 35, -2.0, 2.5), (900, 1100, 30, 0.5, -4.0), (0, 1800, 32, 4.0, 2.5), (-2500, 2000, 32, 2.0, 2.5),
        (0, 1700, 28, -1.0, 2.5), (1400, 1500, 30, -4.0, -3.0), (0, 1600, 33, 0.0, 2.5),
    ):  # fmt: skip
        bend = 0.0 if radius_m == 0 else 1.0 / radius_m
        legs.append(Leg(length_m, speed_mps, bend, grade * _PER_CENT, bank * _PER_CENT))
    return [*legs, Leg(700.0, 25.0, 0.0, 0.0, 2.5 * _PER_CENT)]


def mountain() -> list[Leg]:
    """Up a pass and down again: hairpins of 14 m, bends of 45 to 160 m banked by up to 6 %, grades to 9 %."""

    def way(grade: float) -> Iterator[Leg]:
        yield Leg(200.0, 14.0, 0.0, grade / 2.0)
        for radius_m, angle, speed in ((80, 0.9, 12), (-60, 1.1, 11), (160, 0.7, 14), (-45, 1.3, 10), (55, 1.2, 11)):
            yield Leg(60.0, speed, 0.0, grade)
            bank = math.copysign(5.0 * _PER_CENT, -radius_m)
            yield _turn(abs(radius_m), math.copysign(angle, radius_m), speed, grade, bank)
        for side in (1.0, -1.0, 1.0, -1.0):
            yield Leg(180.0, 12.0, 0.0, grade)
            yield Leg(45.0, 6.0, 0.0, grade)
            yield _turn(14.0, side * 2.0 * QUARTER, 5.0, grade / 2.0, -side * 6.0 * _PER_CENT)

    up, down = list(way(8.0 * _PER_CENT)), list(way(-9.0 * _PER_CENT))
    return [*up, Leg(250.0, 12.0), *down, Leg(200.0, 12.0)]


def car_park() -> list[Leg]:
    """Down five storeys of a helix at walking pace, and up again: steady p, q and r for a minute each."""
    turns = 5.0 * 4.0 * QUARTER
    down = _turn(9.0, turns, 3.0, -10.0 * _PER_CENT, 2.0 * _PER_CENT)
    up = _turn(9.0, -turns, 3.0, 10.0 * _PER_CENT, -2.0 * _PER_CENT)
    return [Leg(60.0, 3.0), down, Leg(80.0, 3.0, stop_s=10.0), up, Leg(200.0, 8.0)]


def crowned_road() -> list[Leg]:
    """Ten minutes on the right half of a crowned road: 2.5 % down to the right, but for some bends."""
    crown = 2.5 * _PER_CENT
    legs = [Leg(800.0, 20.0, 0.0, 0.0, crown)]
    for number in range(10):
        side = 1.0 if number % 2 else -1.0
        legs.append(Leg(250.0, 20.0, side / 500.0, 0.0, crown if side < 0.0 else -crown))
        legs.append(Leg(850.0, 22.0, 0.0, 0.5 * side * _PER_CENT, crown))
    return [*legs, Leg(300.0, 15.0, 0.0, 0.0, crown)]


def roundabouts() -> list[Leg]:
    """A suburb's main road: eight roundabouts of 16 m, falling outwards by 2.5 % as they are built."""
    legs = []
    for number in range(8):
        legs += [Leg(320.0, 15.0), Leg(90.0, 7.0), _turn(15.0, -0.7, 6.0)]
        legs += [_turn(16.0, (2.0 if number % 2 else 4.0) * QUARTER + 0.4, 6.0, 0.0, 2.5 * _PER_CENT)]
        legs += [_turn(15.0, -0.7, 6.0)]
    return [*legs, Leg(250.0, 12.0)]


def off_ramp() -> list[Leg]:
    """Switched on at speed: from a motorway by a loop of 50 m to a country road; no standstill before the end."""
    return [
        Leg(400.0, 30.0, 0.0, 0.0, 2.5 * _PER_CENT),
        Leg(300.0, 20.0, 0.0, 3.0 * _PER_CENT, 2.5 * _PER_CENT),
        Leg(120.0, 11.0, 0.0, 3.0 * _PER_CENT),
        _turn(50.0, -3.0 * QUARTER, 11.0, -4.0 * _PER_CENT, 5.0 * _PER_CENT),
        Leg(1500.0, 22.0, 0.0, 1.0 * _PER_CENT, 2.5 * _PER_CENT),
        Leg(300.0, 22.0, 1.0 / 350.0, 1.0 * _PER_CENT, -4.0 * _PER_CENT),
        Leg(1200.0, 22.0, 0.0, -1.5 * _PER_CENT, 2.5 * _PER_CENT),
    ]


def parking_slope() -> list[Leg]:
    """A minute's waiting on a grade of 12 % with a cross slope of 3 %, then down into the town."""
    tilt = (12.0 * _PER_CENT, 3.0 * _PER_CENT)
    return [
        Leg(60.0, 6.0, 0.0, *tilt),
        Leg(600.0, 12.0, 0.0, -3.0 * _PER_CENT, 0.0, stop_s=10.0),
        Leg(1200.0, 14.0, 0.0, 0.0, 1.0 * _PER_CENT),
        Leg(400.0, 10.0, 0.0, 12.0 * _PER_CENT, 3.0 * _PER_CENT),
    ]


def constant_bank() -> list[Leg]:
    """Two degrees of bank from the first metre to the last: for the wheels, the car is always towed sideways."""
    bank = math.radians(2.0)
    return [Leg(6000.0, 15.0, 0.0, 0.0, bank), Leg(4000.0, 18.0, 0.0, 0.0, bank)]


def handling() -> list[Leg]:
    """Four minutes of a proving ground: slaloms at 0.3 and 0.5 g, braking from 80 km/h, bends at up to 0.6 g."""

    def slalom(radius_m: float, angle: float, speed_mps: float, gates: int) -> Iterator[Leg]:
        yield Leg(110.0, speed_mps)
        for gate in range(gates):
            yield _turn(radius_m, -angle if gate % 2 else angle, speed_mps)

    def bends() -> Iterator[Leg]:
        yield Leg(120.0, 22.0)
        yield Leg(110.0, 9.5)
        yield _turn(18.0, 3.0 * QUARTER, 9.5)
        yield from (Leg(30.0, 9.5), Leg(60.0, 13.0))
        yield _turn(32.0, -3.0 * QUARTER, 13.0)
        yield Leg(30.0, 13.0)

    def gentle() -> Iterator[Leg]:
        yield from slalom(100.0, 0.4, 17.0, 7)
        yield Leg(120.0, 13.0)
        yield _turn(60.0, 2.0 * QUARTER, 13.0)

    way = [*slalom(60.0, 0.4, 17.5, 6), *bends(), *gentle()]
    return [*way, Leg(120.0, 17.0, stop_s=4.0), *way, Leg(150.0, 12.0)]


def snow() -> list[Leg]:
    """A winter's drive over land on packed snow, with three tenths of the grip of dry asphalt."""
    legs = [Leg(400.0, 11.0, 0.0, 0.0, 2.0 * _PER_CENT)]
    for number in range(8):
        side = 1.0 if number % 2 else -1.0
        grade = 1.5 * side * _PER_CENT
        legs.append(Leg(350.0, 12.0, 0.0, grade, 2.0 * _PER_CENT))
        legs.append(Leg(80.0, 8.0, 0.0, grade, 2.0 * _PER_CENT))
        legs.append(_turn(40.0, side * 1.4, 8.0, 0.0, 2.0 * _PER_CENT))
    return [*legs, Leg(400.0, 10.0)]
