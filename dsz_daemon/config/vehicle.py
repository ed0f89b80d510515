"""The `vehicle` section: the car as the single-track model (1) and the wheel speeds need it."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from dsz_daemon.config.sections import Number, Section, bounded
from dsz_daemon.core.parameters import Car

# Bounds: from a kart-sized research vehicle to a loaded three-axle truck's tractor.


class WheelRadius(Section):
    """Rolling radius of each wheel (m); only used where wheel speeds are in rad/s or rpm."""

    fl: Number = bounded(0.1, 1.0, "front left", noun="rolling radius")
    fr: Number = bounded(0.1, 1.0, "front right", noun="rolling radius")
    rl: Number = bounded(0.1, 1.0, "rear left", noun="rolling radius")
    rr: Number = bounded(0.1, 1.0, "rear right", noun="rolling radius")


class VehicleSettings(Section):
    """The car. Required is what the observer (1)-(9) can't do without; the rest has defaults.

    `steering_ratio` and `wheel_radius_m` have defaults only in form: a mapping that needs them
    is refused while they are not given (see `cross_checks`).
    """

    mass_kg: Number = bounded(100, 60000, "mass as driven, people and load included")
    yaw_inertia_kgm2: Number = bounded(20, 1e6, "yaw moment of inertia as driven")
    cg_to_front_axle_m: Number = bounded(
        0.1, 10, "C.G. to front axle, along x", noun="distance from C.G. to front axle"
    )
    cg_to_rear_axle_m: Number = bounded(0.1, 10, "C.G. to rear axle, along x", noun="distance from C.G. to rear axle")
    front_cornering_stiffness_n_per_rad: Number = bounded(1000, 1e6, "of ONE front tyre")
    rear_cornering_stiffness_n_per_rad: Number = bounded(1000, 1e6, "of ONE rear tyre")
    # 1.55 m is within 5 % of every compact to large passenger car.
    front_track_m: Number = bounded(0.5, 3, "front track width", 1.55, "track width")
    rear_track_m: Number = bounded(0.5, 3, "rear track width", 1.55, "track width")
    cg_height_m: Number = bounded(0.1, 4, "C.G. above the road", 0.6, "C.G. height")
    steering_ratio: Number = bounded(1, 50, "steering wheel angle over road wheel angle", 16.0)
    driven_axle: Literal["front", "rear", "all"] = Field(
        "all", description="which wheels may slip under power; `all` trusts none of them blindly"
    )
    wheel_radius_m: WheelRadius = Field(
        default_factory=lambda: WheelRadius(fl=0.33, fr=0.33, rl=0.33, rr=0.33),
        description="rolling radius of each wheel",
    )
    # A body on springs leans outwards and dives. A typical SUV: some 4.5 deg/g in roll and 2.2 deg/g
    # in pitch; sports cars have half of it.
    roll_gradient_rad_per_mps2: Number = bounded(
        0, 0.05, "suspension roll angle per lateral acceleration", 0.008, "roll gradient"
    )
    pitch_gradient_rad_per_mps2: Number = bounded(
        0, 0.05, "suspension pitch angle per longitudinal acceleration", 0.004, "pitch gradient"
    )

    def car(self) -> Car:
        """The same as the core takes it."""
        return Car(
            mass_kg=self.mass_kg,
            yaw_inertia_kgm2=self.yaw_inertia_kgm2,
            cg_to_front_axle_m=self.cg_to_front_axle_m,
            cg_to_rear_axle_m=self.cg_to_rear_axle_m,
            front_track_m=self.front_track_m,
            rear_track_m=self.rear_track_m,
            front_cornering_stiffness_n_per_rad=self.front_cornering_stiffness_n_per_rad,
            rear_cornering_stiffness_n_per_rad=self.rear_cornering_stiffness_n_per_rad,
            front_driven=self.driven_axle in {"front", "all"},
            rear_driven=self.driven_axle in {"rear", "all"},
            roll_gradient_rad_per_mps2=self.roll_gradient_rad_per_mps2,
            pitch_gradient_rad_per_mps2=self.pitch_gradient_rad_per_mps2,
        )
