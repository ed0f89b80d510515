"""Does the core's suite notice a broken core? One mutation at a time, in a copy; run me by hand.

    python tests/mutation/mutations.py [FILE...]

copies the package and the core's tests to a temporary folder, applies one mutation, runs the core's
tests against the copy and prints a Markdown table of which test caught it; with names such as
step.py only the mutations of those files. Exit code 1 if one survives, if its text is not found exactly once, or if the unbroken copy fails. Mutations that
change nothing that can be seen are not listed: a survivor is a missing test.
"""

from __future__ import annotations

import compileall
import os
import re
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[2]
TESTS = ("tests/unit", "tests/property", "tests/consistency")
AT_ONCE = 2
GUARD = """
from pathlib import Path
import dsz_daemon
assert Path(dsz_daemon.__file__).is_relative_to(Path(__file__).parent), dsz_daemon.__file__
"""


class Mutation(NamedTuple):
    """`old` stands exactly once in core/`file`; `new` takes its place."""

    file: str
    equation: str
    old: str
    new: str


MUTATIONS = (
    # the single-track car and its observer
    Mutation("bicycle.py", "(1) a12", "/ (m * v * v) - 1.0", "/ (m * v * v) + 1.0"),
    Mutation("bicycle.py", "(1) a21", "a21=-2.0 * (Cf * lf - Cr * lr) / Iz", "a21=-2.0 * (Cf * lf + Cr * lr) / Iz"),
    Mutation("bicycle.py", "(1) b1", "b1=2.0 * Cf / (m * v)", "b1=Cf / (m * v)"),
    Mutation("bicycle.py", "(3)", "+ (model.a12 + 1.0) * v * r + model.b1", "+ model.a12 * v * r + model.b1"),
    Mutation("bicycle.py", "(7) input", "(model.b2 - gain.k4 * model.b1 * v) * delta", "model.b2 * delta"),
    Mutation("bicycle.py", "(7) matrix", "model.a22 - gain.k3 - gain.k4", "model.a22 + gain.k3 - gain.k4"),
    Mutation("bicycle.py", "(8) K1", "/ (2.0 * Cf * Cr * (lf + lr) ** 2) - 1.0", "/ (2.0 * Cf * Cr * (lf + lr) ** 2)"),
    Mutation("bicycle.py", "(8) K3", "k3 = -2.0 * pole", "k3 = -pole"),
    Mutation("bicycle.py", "(8) switch", "return ObserverGain(k1, 0.0, k3, 0.0)", "return ObserverGain(k1, 1.0 / v, k3, 0.0)"),
    Mutation("bicycle.py", "(9)", "return v * math.tan(beta)", "return v * math.sin(2.0 * beta)"),
    Mutation("bicycle.py", "(9) derivative", "v_rate * tan + v * (1.0 + tan * tan)", "v_rate * tan + v * (1.0 - tan * tan)"),
    # kinematics and attitude
    Mutation("kinematics.py", "(20)", "return v_rate - r * vy", "return v_rate + r * vy"),
    Mutation("kinematics.py", "(21)", "return vy_rate + r * v", "return r * v"),
    Mutation("kinematics.py", "(22) q", "return -q * v + p * vy + G", "return q * v + p * vy + G"),
    Mutation("kinematics.py", "(22) p", "return -q * v + p * vy + G", "return -q * v + G"),
    Mutation("kinematics.py", "(4) total", "ay - G * math.sin(roll)", "ay + G * math.sin(roll)"),
    Mutation("kinematics.py", "(4) road", "road_roll = roll - suspension_roll", "road_roll = roll"),
    Mutation("attitude.py", "phi' = p + r theta", "stepped_2x2(-k, yaw, -yaw, -k", "stepped_2x2(-k, -yaw, yaw, -k"),
    Mutation("attitude.py", "suspension pitch", "-pitch_gradient * longitudinal_mps2", "pitch_gradient * longitudinal_mps2"),
    Mutation("motion.py", "(4) lean", "car.roll_gradient_rad_per_mps2,", "-car.roll_gradient_rad_per_mps2,"),
    Mutation("linear.py", "held input", "xe = -(d * u - b * w) / det", "xe = -(d * u + b * w) / det"),
    Mutation("linear.py", "matrix exponential", "s = 0.5 * (a + d)", "s = 0.25 * (a + d)"),
    # reference speed
    Mutation("speed.py", "3.1 corner", ") / cos + front,", ") / cos - front,"),
    Mutation("speed.py", "3.1 corner, steered", "sideways = (vy + car.cg_to_front_axle_m * r)", "sideways = (vy - car.cg_to_front_axle_m * r)"),
    Mutation("speed.py", "3.1 braking", "return max(wheels)", "return min(wheels)"),
    Mutation("speed.py", "3.1 undriven", "(corners.fl, corners.fr) if car.rear_driven", "(corners.fl, corners.fr) if car.front_driven"),
    Mutation("speed.py", "3.1 limiter", "min(ax - tuning.imu_acceleration_margin_mps2", "min(ax + tuning.imu_acceleration_margin_mps2"),
    Mutation("speed.py", "wheel yaw rate", "(inputs.wheel_speed_rr - inputs.wheel_speed_rl)", "(inputs.wheel_speed_rl - inputs.wheel_speed_rr)"),
    Mutation("speed.py", "v'", "(smoothed - state.smoothed_mps) / dt_s", "(smoothed - state.smoothed_mps)"),
    Mutation("speed.py", "standstill", "and abs(speed) < limit else 0.0", "else 0.0"),
    Mutation("speed.py", "doubt", "if standing and doubt == 0.0 and abs(speed)", "if standing and abs(speed)"),
    Mutation("speed.py", "reverse", "        -fl,\n        -fr,\n        -rl,\n        -rr,\n", "        fl,\n        fr,\n        rl,\n        rr,\n"),
    # motion: who takes what from whom
    Mutation("motion.py", "steering from wheels", "car.wheelbase_m * wheels / v", "-car.wheelbase_m * wheels / v"),
    Mutation("motion.py", "(21) from (9)'s derivative", "motion.v, motion.v_rate, observer", "motion.v, 0.0, observer"),
    Mutation("motion.py", "(4) suspension's input", "lateral = 0.0 if math.isnan(references[1]) else references[1]", "lateral = 0.0 if math.isnan(references[0]) else references[0]"),
    Mutation("motion.py", "(18) roll seen", "kinematics.roll_from_acceleration(ay,", "kinematics.roll_from_acceleration(-ay,"),
    Mutation("motion.py", "(17) pitch seen", "kinematics.pitch_from_acceleration(ax,", "kinematics.pitch_from_acceleration(-ax,"),
    Mutation("motion.py", "adapted stiffness", "        Cr,\n        motion.v,", "        car.rear_cornering_stiffness_n_per_rad,\n        motion.v,"),
    Mutation("motion.py", "rolling yaw rate", "motion.v * delta / car.wheelbase_m, 0.0)", "-motion.v * delta / car.wheelbase_m, 0.0)"),
    Mutation("bicycle.py", "rolling sideslip", "math.atan(lr * math.tan(delta) / (lf + lr))", "math.atan(lf * math.tan(delta) / (lf + lr))"),
    # zeroing
    Mutation("step.py", "(11)", "inputs.gyro_x, 0.0, tilt", "-inputs.gyro_x, 0.0, tilt"),
    Mutation("step.py", "(13)", "inputs.gyro_y, 0.0, tilt", "-inputs.gyro_y, 0.0, tilt"),
    Mutation("step.py", "(15)", "inputs.gyro_z, 0.0, yaw", "-inputs.gyro_z, 0.0, yaw"),
    Mutation("step.py", "(24)-(28)", "target = reference - reading", "target = reading - reference"),
    Mutation("step.py", "(26) c_y", "references[1], z_y, False, tuning, dt_s, c_y, 0.0", "references[1], z_y, False, tuning, dt_s, 1.0, 0.0"),
    Mutation("step.py", "(10)", "zeroing.compensated(inputs.gyro_x, gyros[0])", "inputs.gyro_x"),
    Mutation("step.py", "(12)", "zeroing.compensated(inputs.gyro_y, gyros[1])", "inputs.gyro_y"),
    Mutation("step.py", "(4) into (7)", "observed_motion(car, tuning, state, motion, ay_road, dt_s)", "observed_motion(car, tuning, state, motion, ay, dt_s)"),
    Mutation("step.py", "yaw rate first", "yaw_std = zeroing.offset_std(yaw, tuning.gyro_z)", "yaw_std = 0.0"),
    Mutation("step.py", "implausible", "and not abs(target) <= law.largest_offset:", "and not target <= law.largest_offset:"),
    Mutation("step.py", "bad input", "x if math.isfinite(x) else NAN", "x"),
    Mutation("step.py", "(14)", "used_yaw_rate(zeroing.compensated(inputs.gyro_z, gyros[2])", "used_yaw_rate(inputs.gyro_z"),
    Mutation("step.py", "(25)", "ay = zeroing.compensated(inputs.accel_y, state.accel_y)", "ay = inputs.accel_y"),
    Mutation("zeroing.py", "gain P/S", "D = cosh + variance / density * over_k", "D = cosh + 2.0 * variance / density * over_k"),
    Mutation("zeroing.py", "P' = Q - P^2/S", "(variance * cosh + drift * over_k) / D", "variance * cosh / D"),
    Mutation("zeroing.py", "printed gamma", "drift, 1.0 / tuning.window_s, dt_s)", "drift, tuning.window_s, dt_s)"),
    Mutation("zeroing.py", "(10)", "return reading + state.correction", "return reading - state.correction"),
    # doubt at a standstill
    Mutation("doubt.py", "D17 innovation", "innovation = target - state.correction", "innovation = target + state.correction"),
    Mutation("doubt.py", "D17 scatter", "/ (2.0 * tuning.look_s)", "* (2.0 * tuning.look_s) * 100.0"),
    Mutation("doubt.py", "D17 sigmas", "tuning.sigmas**2 *", "tuning.sigmas *"),
    Mutation("doubt.py", "D17 wait", "doubted < tuning.wait_s", "doubted < 2.0 * tuning.wait_s"),
    Mutation("doubt.py", "D17 hold", "doubted, gap, state.contradiction), False)", "doubted, gap, state.contradiction), True)"),
    Mutation("doubt.py", "D17 spread", "departure, doubted, gap,", "departure, doubted, 0.0,"),
    Mutation("doubt.py", "D17 fading", "math.exp(-2.0 * dt_s / tuning.memory_s)", "math.exp(-dt_s / tuning.memory_s)"),
    Mutation("doubt.py", "D17 believed", "min(state.variance + gap, most)", "min(state.variance, most)"),
    Mutation("doubt.py", "D17 contradiction", "max(state.contradiction, gap)", "state.contradiction"),
    Mutation("zeroing.py", "D17 published", "state.variance + state.doubt + state.contradiction", "state.variance + state.doubt"),
    # what the yaw rate's target neglects
    Mutation("zeroing.py", "D97 published", "told + state.neglected**2 +", "told +"),
    Mutation("zeroing.py", "D97 weighed", "density += neglected * neglected * tuning.neglect_s", "density += 0.0"),
    Mutation("zeroing.py", "D97 mean", "step.share * (neglected - state.neglected)", "neglected - state.neglected"),
    Mutation("zeroing.py", "D97 bound", "min(tuning.largest_offset, neglected)", "neglected"),
    Mutation("doubt.py", "D97 no doubt", "state.variance + state.neglected**2 + scatter", "state.variance + scatter"),
    Mutation("step.py", "D97 printed", "0.0 if tuning.as_printed else agreed", "agreed"),
    Mutation("curve.py", "D97 agreed", "steered * state.wheels_radps <= 0.0", "steered * state.wheels_radps < -1e9"),
    Mutation("curve.py", "D97 less", "min(abs(steered), abs(state.wheels_radps))", "max(abs(steered), abs(state.wheels_radps))"),
    Mutation("curve.py", "D97 zero error", "abs(state.road_wheel_angle_rad) - tuning.yaw_steering_zero_rad", "abs(state.road_wheel_angle_rad)"),
    Mutation("curve.py", "D97 share", "share * bicycle", "bicycle"),
    Mutation("bicycle.py", "D97 steady turn", "model.a21 * model.b1 - model.a11 * model.b2", "model.a21 * model.b1 + model.a11 * model.b2"),
    Mutation("bicycle.py", "D97 oversteer", "if det > 0.0 else math.nan", "if det != 0.0 else math.nan"),
    Mutation("zeroing.py", "hold", "state.variance + tuning.drift_density * dt_s", "state.variance"),
    Mutation("zeroing.py", "scatter", "length * rest * rest / left", "length * rest * rest"),
    Mutation("zeroing.py", "gain's limit", "0.5 * math.log((variance - steady) / (least - steady))", "math.log((variance - steady) / (least - steady))"),
    Mutation("zeroing.py", "first looks", "quick * (1.0 / told - 1.0 / edge)", "quick * (1.0 / told + 1.0 / edge)"),
    Mutation("zeroing.py", "c_y in the scatter", "state.variance, c * target, block_s", "state.variance, target, block_s"),
    # gates
    Mutation("gates.py", "(15)", "if abs(delta) <= tuning.k_r_rad", "if delta <= tuning.k_r_rad"),
    Mutation("gates.py", "(29)", "state.square[i] - state.mean[i] ** 2", "state.square[i]"),
    Mutation("gates.py", "(29) k_i", "(SIGNALS * scales[i] ** 2)", "(SIGNALS * scales[i])"),
    Mutation("gates.py", "Table 3 c1", "transient(state, tuning) < tuning.c1", "transient(state, tuning) < tuning.c7"),
    Mutation("gates.py", "Table 3 c2", "speed_variance(state) >= tuning.c2_m2ps2", "steering_variance(state) >= tuning.c2_m2ps2"),
    Mutation("gates.py", "Table 3 c6", "abs(r) < tuning.c6_radps", "r < tuning.c6_radps"),
    Mutation("gates.py", "turning", "or tuning.as_printed or math.isnan(r)", "or math.isnan(r)"),
    # stability, stiffness
    Mutation("stability.py", "(31) corrected", "g * (c * v * gain.k2 - 1.0)]", "-g]"),
    Mutation("stiffness.py", "yaw balance", "car.cg_to_front_axle_m - Iz * yaw_acceleration", "car.cg_to_front_axle_m + Iz * yaw_acceleration"),
    Mutation("stiffness.py", "slip difference", "delta_mid - car.wheelbase_m * yaw_mid / v", "delta_mid + car.wheelbase_m * yaw_mid / v"),
    Mutation("stiffness.py", "rear compliance", "h2 = -rear / ", "h2 = rear / "),
    # memory
    Mutation("state.py", "resume", "held(doubt.unlooked(state.accel_z), tuning.accel_z", "held(doubt.unlooked(state.accel_y), tuning.accel_z"),
)  # fmt: skip


def copied(folder: Path) -> None:
    """Package and core tests as they stand now, with a guard that they are what gets imported."""
    shutil.copytree(ROOT / "dsz_daemon", folder / "dsz_daemon", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", folder)
    for where, pattern in zip(TESTS, ("*core_*.py", "test_core_*.py", "test_spread.py"), strict=True):
        (folder / where).mkdir(parents=True)
        for path in sorted((ROOT / where).glob(pattern)):
            shutil.copy(path, folder / where)
    (folder / "conftest.py").write_text(GUARD, encoding="utf-8")
    compileall.compile_dir(folder / "dsz_daemon", quiet=1)


def test_files(snapshot: Path, mutation: Mutation | None) -> list[list[str]]:
    """The mutated room's own test files, then all others: most mutations are caught by the first, which is quicker."""
    stem = "" if mutation is None else Path(mutation.file).stem
    rooms = {"attitude": ["kinematics"], "state": ["step"], "step": ["motion", "step", "stability"]}
    own = {f"test_core_{room}" for room in rooms.get(stem, [stem])}
    files = [path.relative_to(snapshot) for where in TESTS for path in sorted((snapshot / where).glob("test_*.py"))]
    first = [str(path) for path in files if path.stem in own]
    return [batch for batch in (first, [str(path) for path in files if path.stem not in own]) if batch]


def failing_test(snapshot: Path, mutation: Mutation | None) -> str:
    """The first test that fails in a mutated copy; "" if all pass. RuntimeError if a run itself broke."""
    with tempfile.TemporaryDirectory(prefix="mutation-") as name:
        folder = Path(name)
        shutil.copytree(snapshot, folder, dirs_exist_ok=True)
        if mutation is not None:
            path = folder / "dsz_daemon" / "core" / mutation.file
            path.write_text(path.read_text(encoding="utf-8").replace(mutation.old, mutation.new), encoding="utf-8")
            # It is told apart by time and size only: a mutation of equal length could run unmutated.
            for compiled in path.parent.glob(f"__pycache__/{path.stem}.*"):
                compiled.unlink()
        for files in test_files(snapshot, mutation):
            if caught := first_failure(folder, files):
                return caught
    return ""


def first_failure(folder: Path, files: list[str]) -> str:
    """The first failing test of one pytest run, "" if there is none."""
    # Compiling takes longer than these tests.
    env = {**os.environ, "PYTHONPATH": str(folder), "PYTHONDONTWRITEBYTECODE": "1", "NUMBA_DISABLE_JIT": "1"}
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-n0", "--tb=no", "-p", "no:cacheprovider", *files]
    run = subprocess.run(command, cwd=folder, env=env, capture_output=True, text=True, check=False, timeout=300)
    if run.returncode == 0:
        return ""
    failed = re.search(r"^FAILED \S*/(\S+?\.py::.+?)(?: - |$)", run.stdout, re.MULTILINE)
    if run.returncode != 1 or failed is None:
        raise RuntimeError(f"pytest ended with {run.returncode}\n{run.stdout[-2000:]}{run.stderr[-2000:]}")
    return failed.group(1)


def misplaced(snapshot: Path, mutation: Mutation) -> bool:
    """Whether the text to mutate does not stand exactly once."""
    text = (snapshot / "dsz_daemon" / "core" / mutation.file).read_text(encoding="utf-8")
    return text.count(mutation.old) != 1


def main(files: list[str]) -> int:
    """Prints the table; 0 if every mutation (of these files, if any are named) was caught."""
    mutations = [mutation for mutation in MUTATIONS if not files or mutation.file in files]
    with tempfile.TemporaryDirectory(prefix="mutation-snapshot-") as name:
        # One snapshot for all: the checkout may change while this runs.
        snapshot = Path(name)
        copied(snapshot)
        lost = [mutation for mutation in mutations if misplaced(snapshot, mutation)]
        for mutation in lost:
            print(f"not found exactly once in core/{mutation.file}: {mutation.old}", file=sys.stderr)
        if lost:
            return 1
        if broken := failing_test(snapshot, None):
            print(f"the unbroken core fails already: {broken}", file=sys.stderr)
            return 1
        with ThreadPoolExecutor(AT_ONCE) as pool:
            caught = list(pool.map(lambda mutation: failing_test(snapshot, mutation), mutations))
    print("| # | equation | core/ | mutation | caught by |\n|---|---|---|---|---|")
    for number, (mutation, test) in enumerate(zip(mutations, caught, strict=True), 1):
        change = " ".join(f"`{mutation.old}` -> `{mutation.new}`".split()).replace("|", "\\|")
        print(f"| {number} | {mutation.equation} | {mutation.file} | {change} | {test or '**survived**'} |")
    print(f"\n{sum(map(bool, caught))} of {len(mutations)} caught.")
    return 0 if all(caught) else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
