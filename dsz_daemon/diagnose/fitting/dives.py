"""A body that dives to a noisy speed: what the simulation's own pitch rate has of the wheels' noise."""

from __future__ import annotations

import math

import numpy as np

from dsz_daemon.diagnose.effects.vocabulary import INDEX
from dsz_daemon.diagnose.recordings.recording import DT_S, filter_kernel
from dsz_daemon.diagnose.simulation import motion
from dsz_daemon.diagnose.simulation.drive import CHANNELS, Drive, Floats

DIVE = "suspension_pitch"
_GRADIENT = INDEX[f"{DIVE}.pitch_gradient_rad_per_mps2"]
_FREQUENCY, _DAMPING = INDEX[f"{DIVE}.frequency_share"], INDEX[f"{DIVE}.damping"]
_PITCH_RATE = CHANNELS.index("gyro_y")
_FRONT, _REAR = slice(6, 8), slice(8, 10)
# So many instants that the low-pass and a body's swing are over.
_INSTANTS = 1024
# What the low-pass leaves of white noise, and the frequencies of that.
_S = 2.0j * math.pi * np.fft.rfftfreq(_INSTANTS, DT_S)
_POWER = np.abs(np.fft.rfft(filter_kernel(), _INSTANTS)) ** 2


def noise_of_a_dive(drive: Drive, x: Floats) -> Floats:
    """The deviation of each channel (13,) of a body that dives by the parameters `x`, for white noise of the wheels.

    Of the pitch rate alone: speed is differentiated, the body follows on its springs, and its angle is differentiated
    again. From v to q it is -k s^2 w^2 / (s^2 + 2 d w s + w^2). Where the car goes evenly it shows this, and no gyro
    does.
    """
    found = np.zeros(len(CHANNELS))
    noises_mps = drive.recording.floor[_FRONT if drive.front_gives_speed else _REAR]
    speed_mps = 0.5 * float(np.hypot(*np.nan_to_num(noises_mps)))
    body_radps = motion.BODY_RADPS * (1.0 + float(x[_FREQUENCY]))
    damping = motion.BODY_DAMPING + float(x[_DAMPING])
    per_mps = _S**2 * body_radps**2 / (_S**2 + 2.0 * damping * body_radps * _S + body_radps**2)
    share = math.sqrt(float(np.sum(_POWER * np.abs(per_mps) ** 2) / np.sum(_POWER)))
    found[_PITCH_RATE] = abs(float(x[_GRADIENT])) * speed_mps * share
    return found
