"""What moves the car: the configured one, with what of it may be off."""

from __future__ import annotations

from dsz_daemon.diagnose.effects.vocabulary import INDEX
from dsz_daemon.diagnose.simulation import motion
from dsz_daemon.diagnose.simulation.drive import Drive, Floats
from dsz_daemon.diagnose.simulation.loads import inertia_of_a_load_kgm2
from dsz_daemon.diagnose.simulation.motion import CarModel

# Of the configured stiffness: less is no tyre.
_SOFTEST = 0.05


def car_of(drive: Drive, x: Floats) -> CarModel:
    """What moves the car, for the parameters `x`."""

    def at(name: str) -> float:
        return float(x[INDEX[name]])

    car = drive.car
    shift, added = at("mass_loading.cg_shift_m"), at("mass_loading.added_mass_kg")
    lf = car.cg_to_front_axle_m * (1.0 + at("cg_to_front_axle_m")) - shift
    lr = car.cg_to_rear_axle_m * (1.0 + at("cg_to_rear_axle_m")) + shift
    front = at("front_cornering_stiffness_n_per_rad") + at("cornering_stiffness.front_scale")
    rear = at("rear_cornering_stiffness_n_per_rad") + at("cornering_stiffness.rear_scale")
    front_track_m = car.front_track_m * (1.0 + at("front_track_m") + at("track_width.front"))
    return CarModel(
        car.mass_kg * (1.0 + at("mass_kg")) + added,
        car.yaw_inertia_kgm2 * (1.0 + at("yaw_inertia_kgm2") + at("yaw_inertia.share"))
        + at("mass_loading.turns") * inertia_of_a_load_kgm2(car, added, shift),
        lf,
        lr,
        2.0 * car.front_cornering_stiffness_n_per_rad * max(1.0 + front, _SOFTEST),
        2.0 * car.rear_cornering_stiffness_n_per_rad * max(1.0 + rear, _SOFTEST),
        at("tyre_relaxation.relaxation_length_m"),
        at("steering_compliance.rad_per_n"),
        at("suspension_roll.roll_gradient_rad_per_mps2"),
        motion.BODY_RADPS * (1.0 + at("suspension_roll.frequency_share")),
        motion.BODY_DAMPING + at("suspension_roll.damping"),
        at("suspension_pitch.pitch_gradient_rad_per_mps2"),
        motion.BODY_RADPS * (1.0 + at("suspension_pitch.frequency_share")),
        motion.BODY_DAMPING + at("suspension_pitch.damping"),
        at("suspension_pitch.air_per_m"),
        motion.SHARPNESS + at("tyre_saturation.sharpness") + at("low_friction.sharpness"),
        at("tyre_saturation.brush") + at("low_friction.brush"),
        at("side_wind.ahead_m"),
        at("side_wind.leans"),
        at("steered_pull"),
        at("steered_brake"),
        at("parallel_steer"),
        front_track_m,
        at("hasty_s"),
        at("load_height_m"),
        at("suspension_roll.swings_m"),
        at("small_wheels"),
        at("unturned_wheels"),
        at("wheels_apart") * 0.5 * front_track_m / (lf + lr),
        at("outer_load.height_m"),
    )
