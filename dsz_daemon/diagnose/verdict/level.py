"""How much is left of each channel, and what that says: the verdict, and how far the numbers are to be trusted."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping

import numpy as np

from dsz_daemon.diagnose.effects.row import WHEELS
from dsz_daemon.diagnose.effects.shape_names import is_of_the_car
from dsz_daemon.diagnose.fitting.model import GRIP, SAME_TURN, TILTS
from dsz_daemon.diagnose.residuals.comparison import noises
from dsz_daemon.diagnose.residuals.locate import channel_names
from dsz_daemon.diagnose.residuals.own_noise import is_its_own, is_shared
from dsz_daemon.diagnose.selection.plausible import is_told
from dsz_daemon.diagnose.selection.search import Search
from dsz_daemon.diagnose.selection.trials import TURNS
from dsz_daemon.diagnose.simulation.drive import CHANNELS
from dsz_daemon.diagnose.surroundings.unfelt_grades import climbs_unfelt
from dsz_daemon.signals import IMU_CHANNELS

# A channel that is off by so many times its noise and the simulation's coarseness is not explained.
UNEXPLAINED = 3.0
# And two of those that tell how a car moves in the plane by so many: of 188 recordings with nothing left out of five
# simulators none has one that is more than 1.4 times off; a load that swings left 2.9 and 2.3.
_TOGETHER, _IN_THE_PLANE = 2.0, ("gyro_z", "accel_x", "accel_y")
# Of 345 with nothing left out of 22 simulators none has a channel of the IMU that is more than 1.32 times off:
# cobblestones, a bracket that rings, and words that are torn are by 1.5 to 5.3.
_BY_ITSELF = 1.5
# So many times more than that a sensor's own noise may be.
_COLOURED = 2.0
# What turns a car, told by its right name, left the yaw rate or the lateral acceleration 1.0 times what may be at most,
# on the cars of six simulators; a load that swings, a trailer, a stability control, rear wheels that steer, where they
# were told by such a name, 1.85 times at least.
TURNED = 1.5
# A wind of gusts that are quicker than its course is drawn left 1.7 and 2.2 times, of 8.9 and 19.4: it took the rest.
# What looked like one (ruts) left nearly all.
_OF_GUSTS = 4.0
# Beside it may be what no yaw gyro shows.
_NO_YAW = frozenset(
    {"accel_scale", "accel_cross_axis", "suspension_roll", "suspension_pitch", "road_grade", "imu_lever_arm"}
)
OF_A_TURN, _TURN = ("gyro_z", "accel_y"), {*TURNS, "steering_delay", "steering_backlash"}
# A limit of grip left both up to 1.8 times what may be, of tyres that are linear up to it; tyres that drive and brakes
# make softer 2.8 times, a power steering that cannot follow 8 times, and a stability control, that brakes wheels
# besides, 1.8 times.
_OF_A_LIMIT = 2.3
# Beside a limit of grip that leaves one of them as far off, what gains less than so much of what the limit does is the
# curve of these tyres: two ratios that were none had 0.08 and 0.10 of it.
_OF_A_CURVE = 0.2
# Where two wheels stay off by so many times what may be, no name was right: of 14 such recordings of six simulators
# three had one, arms beside wheels that were exchanged or copied, and a delay of all that were read in turn.
_OTHER_WHEELS, _WHEELS_OFF = 8.0, 2
# And radii are what makes wheels right: none that stay as they are leave two off by more than this. Nor does a track
# any: a differential that holds wheels together left two of them 2.6 times off, the one track that was another 0.9.
_OTHER_RADII, _OTHER_TRACKS = 5.0, 2.0
# Nor is an IMU late, or slow, that is alone and leaves both that show how a car turns as far off: one that shows each
# reading for a quarter of a second left them 2.3 and 2.8 times, right ones 1.4 at most.
_LATE_IMU = frozenset({"imu_delay", "sensor_bandwidth"})
# A trailer was a relaxation length that gained 1.8 times what the inertia did; rear wheels that follow how a body leans
# were a delay that gained a tenth of that.
_TURNS_LATE, _MORE_THAN_INERTIA = {"tyre_relaxation", "steering_delay"}, 3.0
# The body's alone: how a phone shakes in its holder says nothing of a radius.
_TURN_NO_WHEEL = {"gyro_x", "gyro_y", "accel_z"}


def level_of(found: Search) -> dict[str, float]:
    """Per channel: what is left (rms) over what noise and the simulation's own coarseness may leave."""
    n = found.best.sums.counts.sum(axis=0)
    rms = np.sqrt((found.best.sums.left * found.best.scatter**2).sum(axis=0) / np.maximum(n, 1.0))
    expected = np.hypot(noises(found.drive), found.best.form)
    names = channel_names(found.drive)
    return {name: float(rms[c] / expected[c]) for c, name in enumerate(names) if n[c] > 0 and expected[c] > 0.0}


def nominal_level(found: Search) -> dict[str, float]:
    """The same of the nominal simulation."""
    return level_of(found._replace(best=found.nominal))


def unexplained_of(found: Search, level: Mapping[str, float], imu_by: float = UNEXPLAINED) -> list[str]:
    """Channels that are off by more than noise and coarseness leave, and not by a sensor's own colour of noise."""
    names, (drive, rows, left) = channel_names(found.drive), (found.drive, found.rows, found.best.left)

    def is_noise(name: str) -> bool:
        c = names.index(name)
        return is_its_own(drive, rows, left[:, c], c) and not is_shared(rows, left, c, len(IMU_CHANNELS))

    return [
        name
        for name, value in level.items()
        if value > (imu_by if name in IMU_CHANNELS else UNEXPLAINED)
        and (name not in IMU_CHANNELS or value > _COLOURED * UNEXPLAINED or not is_noise(name))
    ]


def off_together(level: Mapping[str, float]) -> list[str]:
    """Channels of how a car moves in the plane that are off, if two are: what shows in two is no sensor's own."""
    off = [channel for channel in _IN_THE_PLANE if level.get(channel, 0.0) >= _TOGETHER]
    return off if len(off) > 1 else []


def off_where_nothing_is_said(found: Search, level: Mapping[str, float]) -> set[str]:
    """Channels that are off, where no name and no shape is said: less is enough there to say that something is.

    Of the IMU's channels each by itself, by what is no noise of its own.
    """
    return {*unexplained_of(found, level, _BY_ITSELF), *off_together(level)}


def turned_by_another(found: Search, level: Mapping[str, float]) -> tuple[set[str], list[str]]:
    """Names of what turns a car that leave it turning otherwise, and the channels that show it; none where one doesn't.

    Another stiffness, load, ratio or delay fits somewhat whatever turns the car. It is that only if the yaw rate and
    the lateral acceleration are right then, not just better. At the limit of grip, where that explains the most, no
    simulation has either right, but for one that has both wrong by far, or wheels as well, or turns besides by what
    has no name; and what explains little beside it, where either is wrong, is the curve of its tyres. One that explains
    less is no limit: what was chosen before it is not there. An IMU that is late shows both, later. Nor is a zero of
    the steering told where the car turns otherwise to either side.
    """
    names, limits, zero = (kind & set(found.best.effects) for kind in (_TURN, GRIP, {"steering_offset"}))
    channels = [channel for channel in OF_A_TURN if channel in level]
    # A wind takes what the accelerometer has left, whatever that is of: the yaw rate alone says whether it is one.
    blown = {"side_wind"} & set(found.best.effects)
    off = sorted(level[channel] for channel in channels if not blown or channel != "accel_y")
    alone = set(found.best.effects)
    if alone and alone <= _LATE_IMU and len(off) > 1 and off[0] >= TURNED:
        return alone, channels
    # One that is off may be off by its own instrument; but not by one that swings, which is said to explain it.
    if not names | limits | blown | zero or not off or off[-1] < TURNED:
        return set(), []
    limit = max((found.gains[limit] for limit in limits), default=0.0)
    of_limit = limit > max((found.gains[one] for one in names), default=0.0)
    rolls = max((value for name, value in level.items() if name.startswith("wheel_")), default=0.0)
    is_wrong = off[0] >= TURNED or "soft_mount" in found.best.effects
    if blown and alone <= blown | _NO_YAW and off[0] < UNEXPLAINED:
        is_wrong = nominal_level(found)["gyro_z"] < _OF_GUSTS * off[0]
    if of_limit:
        is_far = off[0] >= _OF_A_LIMIT or rolls >= UNEXPLAINED * _COLOURED
        is_wrong &= (len(off) > 1 or bool(blown)) and (is_far or any(map(is_of_the_car, found.best.effects)))
    if not is_wrong:
        return {name for name in names if found.gains[name] < _OF_A_CURVE * limit}, []
    return names | limits | blown | zero, channels


def driven_by_other_wheels(found: Search, level: Mapping[str, float]) -> set[str]:
    """All names but a road's, where wheels of a car are off by far: what they say drives the simulation, too.

    Their radii, where they are off by less, and their tracks, where one is.
    """
    rolls = [value for name, value in level.items() if name.startswith("wheel_")]
    if sum(value > _OTHER_WHEELS for value in rolls) >= _WHEELS_OFF:
        return set(found.best.effects) - TILTS
    wrong = {"wheel_radius"} if sum(value > _OTHER_RADII for value in rolls) >= _WHEELS_OFF else set[str]()
    wrong |= {"track_width"} if max(rolls, default=0.0) > _OTHER_TRACKS else set()
    return wrong & set(found.best.effects)


def curve_of_an_axle(found: Search) -> set[str]:
    """Names that gain little beside an axle whose wheels turn alike: how that scrubs is but sketched."""
    there = set(found.best.effects)
    if "locked_axle" not in there:
        return set()
    axle = max(found.gains[one] for one in {"locked_axle", *TURNS} & there)
    return {one for one in {"imu_lever_arm", *_TURN} & there if found.gains[one] < _OF_A_CURVE * axle}


def late_besides(found: Search, sure: Collection[str]) -> set[str]:
    """Names of what turns a car late beside what has no name and does so, too, and is `sure`.

    A car as configured that is harder or easier to turn has something that swings or leans, of which both are a part,
    where the name gains little more; and of wheels that lag behind the hand the lag is but sketched.
    """
    fit, there = found.best, _TURNS_LATE & set(found.best.effects)
    told = {one for one in ("yaw_inertia", "steering_lag") if one in sure and is_told(found.drive, fit, one)}
    if "steering_lag" in told:
        return there
    if "yaw_inertia" not in told or SAME_TURN & set(fit.effects):
        return set()
    return {one for one in there if found.gains[one] < _MORE_THAN_INERTIA * found.gains["yaw_inertia"]}


def verdict(explained: bool, left: bool) -> str:
    """The contract's word for it."""
    if left:
        return "partly_explained" if explained else "unexplained"
    return "explained" if explained else "consistent"


def doubt(found: Search, unexplained: Collection[str]) -> float:
    """What is left of the channel that is explained the least, over what may be, in its usual block: 1 or more.

    The usual one, since blocks in which the simulation is wrong by more say less already.
    """
    names, expected = channel_names(found.drive), np.hypot(noises(found.drive), found.best.form)
    channels = [names.index(name) for name in unexplained]
    seen = found.best.sums.counts > 0
    usual = [float(np.median(found.best.scatter[seen[:, c], c]) / expected[c]) for c in channels]
    return max([1.0, *usual])


def doubt_of(found: Search, effect: str, unexplained: Collection[str]) -> float:
    """What is left over what may be, of the channels that an effect is judged by.

    A grade that no gyro feels is judged by one. And of the wheels that drive no simulation nothing comes into the
    others: what they do is a matter of wheels. No wheel turns by how a body rolls, pitches or heaves. And a wind whose
    yaw rate is right leaves the lateral acceleration what is quicker than its course is drawn.
    """
    if effect == "road_grade" and climbs_unfelt(found.drive):
        return doubt(found, {"accel_x"} & set(unexplained))
    if effect == "side_wind" and level_of(found).get("gyro_z", math.inf) < TURNED:
        return doubt(found, set(unexplained) - {"accel_y"})
    if found.drive.vocabulary.described(effect).touches == WHEELS:
        return doubt(found, set(unexplained) - _TURN_NO_WHEEL)
    names = zip(channel_names(found.drive), CHANNELS, strict=True)
    return doubt(found, set(unexplained) - {name for name, channel in names if channel.startswith("wheel_other")})
