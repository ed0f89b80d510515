"""A load turns with the car: from where it stands by what it weighs and moves the C.G., about the common one."""

from __future__ import annotations

from dsz_daemon.core.parameters import Car

LOAD = "mass_loading"
# Where people and luggage are at least, from the C.G.: some stand on the other side of it. What moves the C.G. further
# than that would stands further out, but between the axles.
_FROM_THE_CG_M = 0.8


def inertia_of_a_load_kgm2(car: Car, added_kg: float, shift_m: float) -> float:
    """Yaw inertia of a load, SI, about the common C.G.: m M/(m + M) d^2 (parallel axes), d = |shift| (m + M)/m."""
    whole_kg = car.mass_kg + added_kg
    if added_kg == 0.0 or whole_kg <= 0.0:
        # Nothing is on board, or more is taken off than there is: a trial fit of a light car goes there.
        return 0.0
    out_m = min(max(abs(shift_m * whole_kg / added_kg), _FROM_THE_CG_M), 0.5 * car.wheelbase_m)
    return car.mass_kg * added_kg / whole_kg * out_m**2
