"""Inside, under systemd: the service's life. Start, READY, crash, hang, reload, stop, start again."""

from __future__ import annotations

import os
import signal
import sys
import time
from pathlib import Path

import service_bench as bench
from guest_checks import LONG_S, Checks, run
from service_bench import CONFIG, Unit, command, missed_ticks, publishes, restored_age_s, said, status, yaw_offset

DSZ = Unit("dsz.service")
STATE = Path("/var/lib/private/dsz/offsets.json")


def life(checks: Checks) -> None:
    """All of it, in the order of a drive with bad luck."""
    bench.prepare(checks, "save_period_s: 2")
    bench.sound(checks, DSZ.name, 1.0)
    enabled(checks)
    waiting(checks)
    player = bench.play()
    ready(checks)
    confined(checks)
    crash(checks)
    hang(checks)
    reload_good(checks)
    reload_bad(checks)
    stop_and_start(checks)
    player.kill()
    fields(checks)


def enabled(checks: Checks) -> None:
    command("systemctl", "enable", "dsz")
    boot = Unit("multi-user.target")
    checks.check("enabled, it is wanted at boot", "dsz.service" in boot["Wants"].split())
    checks.check("a silent bus does not hold up the boot", "dsz.service" not in boot["After"].split())


def waiting(checks: Checks) -> None:
    """No frames: neither ready nor failed, and watched over all the same."""
    command("systemctl", "start", "--no-block", "dsz")
    checks.until("STATUS while no frames come", lambda: DSZ["StatusText"] == "waiting for frames on can0")
    checks.equal("not READY while no frames come", DSZ["ActiveState"], "activating")
    heard = DSZ["WatchdogTimestampMonotonic"]
    checks.until(
        "the watchdog hears of the waiting daemon", lambda: DSZ["WatchdogTimestampMonotonic"] not in {"0", heard}
    )


def ready(checks: Checks) -> None:
    before = int(DSZ["NRestarts"])
    checks.until("READY once frames flow", lambda: DSZ.is_active)
    checks.check("STATUS says running", DSZ["StatusText"].startswith("running on can0"), DSZ["StatusText"])
    checks.check("it publishes", publishes())
    checks.equal("the same process that waited", int(DSZ["NRestarts"]), before)


def confined(checks: Checks) -> None:
    """What the kernel thinks of the running process."""
    process = DSZ.process()
    checks.check("not root", DSZ.user not in {"", "0"}, DSZ.user)
    for key in ("CapEff", "CapBnd", "CapAmb"):
        checks.equal(f"no capability ({key})", int(process.get(key, "-1"), 16), 0)
    checks.equal("system calls are filtered", process.get("Seccomp"), "2")
    checks.equal("no new privileges", process.get("NoNewPrivs"), "1")
    pid = DSZ.pid
    children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    nice = [os.getpriority(os.PRIO_PROCESS, int(who)) for who in (pid, *children)]
    checks.check("it goes before others, its children do not", nice[0] == -10 and {*nice[1:]} == {0}, nice)
    checks.equal("the status socket is 0660", said("stat", "-c", "%a", "/run/dsz/status.sock"), "660")


def crash(checks: Checks) -> None:
    begun_s = time.time()
    checks.until("it saves from time to time", lambda: STATE.exists() and STATE.stat().st_mtime > begun_s)
    restarts, pid = int(DSZ["NRestarts"]), DSZ.pid
    begun_s = time.monotonic()
    DSZ.signal(signal.SIGKILL)
    checks.until("restarted after SIGKILL", lambda: int(DSZ["NRestarts"]) == restarts + 1 and DSZ.is_active)
    checks.tell(f"{time.monotonic() - begun_s:.1f} s from SIGKILL to active")
    checks.check("with a new process", DSZ.pid not in {0, pid})
    age_s = restored_age_s()
    checks.check("what was saved before the crash is known again", 0 < age_s < LONG_S, age_s)


def hang(checks: Checks) -> None:
    restarts, pid = int(DSZ["NRestarts"]), DSZ.pid
    bites = DSZ.journal().count("Watchdog timeout")
    begun_s = time.monotonic()
    DSZ.signal(signal.SIGSTOP)
    checks.until(
        "a daemon that hangs is restarted", lambda: int(DSZ["NRestarts"]) > restarts and DSZ.pid not in {0, pid}
    )
    checks.tell(f"{time.monotonic() - begun_s:.1f} s from SIGSTOP to a new process")
    checks.equal("by the watchdog", DSZ.journal().count("Watchdog timeout"), bites + 1)


def reload_good(checks: Checks) -> None:
    checks.until("running again", lambda: DSZ.is_active)
    pid, before = DSZ.pid, yaw_offset()
    good = CONFIG.read_text()
    CONFIG.write_text(good.replace("mass_kg: 1673.0", "mass_kg: 1700.0"))
    missed, begun_s = missed_ticks(), time.monotonic()
    done = command("systemctl", "reload", "dsz")
    checks.equal("systemctl reload", done.returncode, 0)
    checks.until("a good configuration is taken over", lambda: status().get("reloads") == 1)
    checks.tell(f"{time.monotonic() - begun_s:.1f} s from reload to taken over, {missed_ticks() - missed} ticks missed")
    after = yaw_offset()
    # What was learnt goes on: the spread of a fresh start is tens of times this.
    checks.check("with what was learnt", after["offset_std"] < 2.0 * before["offset_std"], (before, after))
    checks.until("READY again", lambda: DSZ["SubState"] == "running")
    checks.equal("by the same process", DSZ.pid, pid)
    checks.equal("the journal says reloaded", len(DSZ.events("reloaded")), 1)


def reload_bad(checks: Checks) -> None:
    pid, good = DSZ.pid, CONFIG.read_text()
    CONFIG.write_text(good.replace("mass_kg: 1700.0", "mass_kg: -5"))
    begun_s = time.monotonic()
    command("systemctl", "reload", "dsz")
    refused = checks.until("a bad configuration is refused", lambda: DSZ.events("reload_refused"))
    checks.tell(f"{time.monotonic() - begun_s:.1f} s from reload to refused")
    checks.check(
        "the journal says why", refused and "mass" in refused[0]["MESSAGE"] and "-5" in refused[0]["MESSAGE"], refused
    )
    checks.until("the old one goes on", lambda: DSZ["SubState"] == "running" and publishes())
    checks.equal("in the same process", DSZ.pid, pid)
    checks.equal("and is the one in force", status().get("reloads"), 1)
    CONFIG.write_text(good)


def stop_and_start(checks: Checks) -> None:
    offset = yaw_offset()
    stopped_s = time.time()
    checks.equal("systemctl stop", command("systemctl", "stop", "dsz").returncode, 0)
    checks.equal("it ended well", (DSZ["Result"], DSZ["ExecMainStatus"]), ("success", "0"))
    checks.check("stop saves the state", STATE.stat().st_mtime >= stopped_s - 1.0)
    checks.equal("which is nobody else's", said("stat", "-c", "%a", STATE.parent), "700")
    checks.equal("its runtime directory is gone", Path("/run/dsz").exists(), False)
    refused_at_start(checks)
    begun_s = time.monotonic()
    command("systemctl", "start", "dsz")
    checks.tell(f"{time.monotonic() - begun_s:.1f} s from start to READY")
    checks.check("started again", DSZ.is_active)
    age_s, since_s = restored_age_s(), time.time() - stopped_s
    checks.check("with the saved offsets, and their age", 0 < age_s < since_s, age_s)
    again = yaw_offset()
    moved = abs(again["offset"] - offset["offset"])
    checks.check("which are the ones it had", moved < 3 * offset["offset_std"], (offset, again))
    checks.check("as sure as before", again["offset_std"] < 3 * offset["offset_std"], (offset, again))


def refused_at_start(checks: Checks) -> None:
    """What does not mend itself is not tried again each second, and spoils nothing."""
    good, state = CONFIG.read_text(), STATE.read_bytes()
    told = DSZ.journal().count("mass_kg")
    CONFIG.write_text(good.replace("mass_kg: 1700.0", "mass_kg: -5"))
    checks.check("a start with a bad configuration fails", command("systemctl", "start", "dsz").returncode != 0)
    checks.equal("with exit code 2", (DSZ["Result"], DSZ["ExecMainStatus"]), ("exit-code", "2"))
    time.sleep(2.0)  # a restart comes after one
    checks.equal("and is not tried again", (DSZ["ActiveState"], DSZ["NRestarts"]), ("failed", "0"))
    checks.check("the journal says why", DSZ.journal().count("mass_kg") > told)
    checks.equal("the saved offsets are as they were", STATE.read_bytes(), state)
    CONFIG.write_text(good)


def fields(checks: Checks) -> None:
    (event, *_) = DSZ.events("restored") or [{}]
    checks.equal("an event has its unit", event.get("_SYSTEMD_UNIT"), "dsz.service")
    checks.equal("its priority", event.get("PRIORITY"), "5")
    checks.equal("its sender", event.get("SYSLOG_IDENTIFIER"), "dsz")


if __name__ == "__main__":
    sys.exit(run(life, bench.journal))
