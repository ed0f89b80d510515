"""What the simulated car is made of: one frozen record of numbers, each with its source.

The default is the paper's Hyundai Tucson ix 2WD, two people up. "Paper" is its Table 4; the
yaw inertia, C.G. height, stiffnesses and ratio are those of the project's example
configuration. What neither gives is marked "chosen", with the reason; `docs/decisions/0004`
tells how far the results depend on it.
"""

from __future__ import annotations

from dataclasses import dataclass

from dsz_daemon.signals import STANDARD_GRAVITY_MPS2


@dataclass(frozen=True, slots=True)
class Car:
    """Parameters of the two-track car; lengths from the C.G., inertias about it."""

    mass_kg: float = 1673.0  # paper
    cg_to_front_axle_m: float = 1.149  # paper: from the four corner weights
    cg_to_rear_axle_m: float = 1.491  # paper
    front_track_m: float = 1.585  # paper
    rear_track_m: float = 1.586  # paper
    front_wheel_radius_m: float = 0.337  # paper, loaded
    rear_wheel_radius_m: float = 0.340  # paper, loaded
    cg_height_m: float = 0.66  # example configuration
    yaw_inertia_kgm2: float = 2850.0  # example configuration
    # Chosen: radii of gyration of 0.62 m and 1.27 m, a compact SUV (roll well below, pitch a
    # little below yaw). They shape transients of roll and pitch only.
    roll_inertia_kgm2: float = 643.0
    pitch_inertia_kgm2: float = 2700.0
    # Chosen: wheel rates for a ride frequency of 1.4 Hz and bars for 6 deg of roll per g,
    # the middle of what road tests report for compact SUVs.
    front_spring_n_per_m: float = 30000.0
    rear_spring_n_per_m: float = 32000.0
    front_damper_ns_per_m: float = 2500.0  # chosen: 0.35 of critical in heave
    rear_damper_ns_per_m: float = 2500.0
    front_bar_nm_per_rad: float = 24000.0
    rear_bar_nm_per_rad: float = 12000.0
    # One tyre, small slip, static load: the example configuration's.
    front_cornering_stiffness_n_per_rad: float = 62000.0
    rear_cornering_stiffness_n_per_rad: float = 68000.0
    # Chosen: about 18 times the static load, a road tyre.
    front_slip_stiffness_n: float = 80000.0
    rear_slip_stiffness_n: float = 80000.0
    friction: float = 1.0  # chosen: dry asphalt, as in the paper's test
    shape: float = 1.3  # the Magic Formula's C for lateral force (Pacejka, 1.3)
    # Chosen: stiffness grows less than load: 2 x the load gives 1.5 x the stiffness.
    load_sensitivity: float = 1.0  # 0: the load does not matter
    load_degression: float = 0.25
    lateral_relaxation_m: float = 0.5  # chosen: stiffness over a carcass of 130 kN/m
    longitudinal_relaxation_m: float = 0.2  # chosen: stiffness over a carcass of 400 kN/m
    wheel_inertia_kgm2: float = 1.2  # chosen: 17 inch wheel and tyre of about 22 kg
    rolling_resistance: float = 0.012  # chosen: road tyre on asphalt
    drag_area_m2: float = 0.95  # chosen: cd 0.37 on 2.6 m2
    # Chosen: a side wind acts at the C.G.'s height and a quarter of a metre ahead of it, an SUV's usual yaw moment.
    wind_ahead_m: float = 0.25
    wind_up_m: float = 0.0
    front_drive_share: float = 1.0  # paper: 2WD
    front_brake_share: float = 0.65  # chosen: usual proportioning
    # What the driven wheels alone slow the car by, at most, before the brakes come on: 0.3 to 0.8 in gear with the
    # pedal up, 1.5 to 2.5 where an electric motor recuperates.
    engine_braking_mps2: float = 0.0
    # What lateral force turns the front wheels back by: 0, or some 1e-6 rad/N in road cars (a degree at 1 g).
    steering_compliance_rad_per_n: float = 0.0
    # Play between steering wheel and road wheels, at these.
    steering_backlash_rad: float = 0.0
    steering_offset_rad: float = 0.0
    # True over nominal, and by how much more per radian of the steering wheel.
    steering_ratio_scale: float = 1.0
    steering_ratio_per_rad: float = 0.0
    # True over nominal radius, front left to rear right: what the wheel speeds are wrong by.
    wheel_radius_scale: tuple[float, float, float, float] = (1.0, 1.0, 1.0, 1.0)
    # A body that can't lean or dive keeps the road's attitude; its wheels keep their static load.
    leans: bool = True
    dives: bool = True
    # Wheels that can't slip show the speed of their hubs.
    slips: bool = True
    steering_ratio: float = 15.7  # example configuration
    # Paper, Table 5: RT3100 1.000 m ahead of the rear axle and 0.600 m below the antenna on
    # the roof (1.655 m high), IMU 0.930 m further ahead and 0.430 m below it.
    imu_x_m: float = 1.000 + 0.930 - 1.491
    imu_y_m: float = 0.0
    imu_z_m: float = 1.655 - 0.600 - 0.430 - 0.66

    @property
    def wheelbase_m(self) -> float:
        """Distance between the axles."""
        return self.cg_to_front_axle_m + self.cg_to_rear_axle_m

    @property
    def front_static_load_n(self) -> float:
        """Load of one front tyre, standing on level ground."""
        weight_n = self.mass_kg * STANDARD_GRAVITY_MPS2
        return weight_n * self.cg_to_rear_axle_m / (2.0 * self.wheelbase_m)

    @property
    def rear_static_load_n(self) -> float:
        """Load of one rear tyre, standing on level ground."""
        weight_n = self.mass_kg * STANDARD_GRAVITY_MPS2
        return weight_n * self.cg_to_front_axle_m / (2.0 * self.wheelbase_m)


TUCSON = Car()
