"""A bank where no roll gyro is to feel it: by what the lateral accelerometer shows beyond the turn.

On a tilted road it shows what the tyres push: reading_y = v r + v_y' + g phi. The yaw rate is measured; how the car
slides to the bank is simulated. Both channels are taken for the profile. What judges it is the car: it has to yaw as
this bank makes it, m (v_y' + r v) = F_y - m g phi.
"""

from __future__ import annotations

import numpy as np

from dsz_daemon.diagnose.effects.vocabulary import INDEX
from dsz_daemon.diagnose.recordings.recording import DT_S, filtered
from dsz_daemon.diagnose.simulation import motion
from dsz_daemon.diagnose.simulation.drive import Drive, Floats
from dsz_daemon.diagnose.simulation.moving import driven
from dsz_daemon.diagnose.simulation.prediction import gyros_of, shown
from dsz_daemon.diagnose.simulation.road import Profiles
from dsz_daemon.diagnose.simulation.rolling import Rolling
from dsz_daemon.diagnose.surroundings.unfelt_grades import climbs_unfelt

ROLL_GYRO, YAW_GYRO, ACROSS = 0, 2, 4
_SCALE = INDEX["accel_scale.y"]
# How the car slides to a bank is some hundredths of it: as it would to the last round's.
_ROUNDS = 2


def is_unfelt(drive: Drive) -> bool:
    """Whether there is no roll gyro, but a yaw gyro and a lateral accelerometer."""
    has = [bool(np.isfinite(drive.measured[:, c]).any()) for c in (ROLL_GYRO, YAW_GYRO, ACROSS)]
    return has == [False, True, True]


def untold_beside(drive: Drive) -> set[int]:
    """Columns that a road which no gyro feels leaves untold.

    Knots, which correct what a gyro drifts by; and what leaks of the vertical into the accelerometer that it is taken
    from, which is a constant and the road's own rise and fall.
    """
    found = set[int]()
    for road, leak, is_there in (("road_bank", "yz", is_unfelt(drive)), ("road_grade", "xz", climbs_unfelt(drive))):
        if is_there:
            found |= {*drive.vocabulary.columns_of(road), INDEX[f"accel_cross_axis.{leak}"]}
    return found


def bank_by_the_turn(
    drive: Drive, x: Floats, level: Profiles, rolls: Rolling, kernel: Floats, leans_too: float
) -> Floats:
    """Bank (n,) in rad that the accelerometer shows beyond the turn, behind the low-pass of roads.

    Of a sensor that is late, it is late, too. `leans_too`: what a body turns on a bank over what the road does.
    """
    flat_out = driven(drive, x, level, rolls)
    left = np.nan_to_num(drive.measured - shown(drive, x, flat_out))
    turned, pushed = left[:, YAW_GYRO] / gyros_of(x)[0][2, 2], left[:, ACROSS] / ((1.0 + x[_SCALE]) * leans_too)
    beyond_mps2, slides = pushed - flat_out.v_mps * turned, np.zeros(len(turned))
    bank = np.zeros(len(turned))
    for _ in range(_ROUNDS):
        bank = filtered((beyond_mps2 - slides) / motion.G, kernel)
        on_it = driven(drive, x, level._replace(bank_rad=bank), rolls)
        slides = np.nan_to_num(np.gradient(on_it.moved[:, motion.VY] - flat_out.moved[:, motion.VY], DT_S))
    return bank
