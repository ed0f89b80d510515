"""What can be said on the command line: verbs, options, their words. `cli` calls what they ask for."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import NoReturn

from dsz_daemon import __version__
from dsz_daemon.errors import ConfigError


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise ConfigError(f"{message}; see `{self.prog} --help`")


class _Effects(argparse.Action):
    """Prints the simulated car's effects and ends, as --help does."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        from dsz_daemon.sim.effect_words import vocabulary

        print(vocabulary(), end="")
        parser.exit()


def _positive(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0.0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text!r} is not a number above 0")
    return value


def _count(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number above 0")
    return int(text)


def parser() -> argparse.ArgumentParser:
    """All verbs; `verb` of what it parses says which one was asked for. ConfigError: a wrong command line."""
    top = _Parser(
        prog="dsz",
        description="Takes the offset errors out of a vehicle's 6-axis IMU, live on CAN or over recordings.",
    )
    top.add_argument("--version", action="version", version=f"dsz {__version__}")
    verbs = top.add_subparsers(dest="verb", required=True, metavar="VERB", parser_class=_Parser)

    run = verbs.add_parser("run", help="the live daemon", description="The live daemon.")
    _config(run)
    run.add_argument(
        "--bus",
        action="append",
        default=[],
        metavar="NAME=INTERFACE:CHANNEL",
        help="another bus than configured, e.g. can0=socketcan:vcan0; may be repeated",
    )
    run.add_argument("-o", "--output", type=Path, metavar="DIR", help="also write samples, log, summary and report")
    run.add_argument("--record", type=Path, metavar="LOG", help="also record all received frames as candump text")
    run.add_argument("--duration", type=_positive, metavar="S", help="end after so many seconds")
    run.add_argument("--state", type=Path, metavar="FILE", help="keep the offsets here across restarts")
    run.add_argument("--status", type=Path, metavar="SOCKET", help="answer `dsz status` on this Unix socket")
    _json(run)

    replay = verbs.add_parser(
        "replay", help="the same loop over a recording", description="The same loop over a recording."
    )
    replay.add_argument("logs", nargs="+", type=Path, metavar="LOG", help="one recording, in pieces in time order")
    _config(replay)
    replay.add_argument("-o", "--output", type=Path, required=True, metavar="DIR", help="where the results go")
    replay.add_argument("--speed", type=_positive, help="1 = real time; without it, as fast as it goes")
    replay.add_argument(
        "--to", metavar="BUS", help="play recording and result onto a bus: vcan0, or INTERFACE:CHANNEL (at speed 1)"
    )
    replay.add_argument("--truth", type=Path, metavar="FILE", help="truth.parquet of a simulation: adds the errors")
    _json(replay)

    simulate = verbs.add_parser(
        "simulate",
        help="a simulated drive: recording, configuration, DBC, truth",
        description="Writes recording.log, its config.yaml and DBC, truth.parquet, parameters.json: what was true, and "
        "drive.html: a picture of what was driven. "
        "Effects change the car, its road or its sensors, never what config.yaml says.",
    )
    simulate.add_argument(
        "scenario", metavar="SCENARIO", help="sine_steer, bank_and_incline, city, highway, ... (a wrong name lists all)"
    )
    simulate.add_argument("-o", "--output", type=Path, required=True, metavar="DIR", help="where the files go")
    simulate.add_argument("--seed", type=int, default=1, help="same seed, same bytes (default 1)")
    simulate.add_argument(
        "--effect",
        action="append",
        default=[],
        metavar="NAME[:KEY=VALUE,...]",
        help="what else is true, e.g. imu_lever_arm:x_m=0.5,z_m=0.2 or side_wind; may be repeated, in any order",
    )
    simulate.add_argument("--effects", action=_Effects, nargs=0, help="list all effects and their parameters")
    simulate.add_argument(
        "--nominal",
        action="store_true",
        help="take out all that the nominal simulation leaves out, then put effects in",
    )
    _json(simulate)

    check = verbs.add_parser(
        "check",
        help="every fault of a configuration at once",
        description="Checks a configuration against its DBC and its own stability; every fault at once.",
    )
    check.add_argument("config", type=Path, metavar="CONFIG")
    _json(check)

    demo = verbs.add_parser(
        "demo",
        help="simulated car -> virtual CAN -> daemon -> table and report",
        description="Simulates a drive, plays it onto a virtual CAN bus, runs the live daemon on it, reports.",
    )
    demo.add_argument("-o", "--output", type=Path, default=Path("out/demo"), metavar="DIR", help="default out/demo")
    demo.add_argument("--scenario", default="sine_steer", help="default sine_steer")
    demo.add_argument("--seed", type=int, default=1)
    demo.add_argument("--speed", type=_positive, default=5.0, help="times real time (default 5)")
    _json(demo)
    _diagnose_verb(verbs)
    _prove_verb(verbs)
    _bench_verb(verbs)
    _asking_verbs(verbs)
    _install_verb(verbs)
    return top


def _diagnose_verb(verbs: argparse._SubParsersAction[_Parser]) -> None:
    diagnose = verbs.add_parser(
        "diagnose",
        help="what physics a simulation of the recording leaves out",
        description="Holds the nominal simulation against a recording; names what was left out and shows the fit.",
    )
    diagnose.add_argument("logs", nargs="+", type=Path, metavar="LOG", help="one recording, in pieces in time order")
    _config(diagnose)
    diagnose.add_argument("-o", "--output", type=Path, required=True, metavar="DIR", help="where the results go")
    diagnose.add_argument(
        "--reference",
        type=Path,
        metavar="FILE",
        help="measured states (.csv, .parquet): time_s, vx_mps, grade_up_rad ...",
    )
    diagnose.add_argument(
        "--simulation",
        type=Path,
        metavar="FILE",
        help="your own simulation of the recording instead of the nominal one",
    )
    _json(diagnose)


def _prove_verb(verbs: argparse._SubParsersAction[_Parser]) -> None:
    prove = verbs.add_parser(
        "prove",
        help="the blind proof of diagnose, sealed and scored",
        description="Makes recordings whose truth is sealed, diagnoses them blind, opens the seals and scores.",
    )
    prove.add_argument(
        "-o", "--output", type=Path, required=True, metavar="DIR", help="keeps all; goes on where it was"
    )
    prove.add_argument("--trials", type=_count, default=40, metavar="N", help="so many recordings (default 40)")
    prove.add_argument("--seed", type=int, default=1, metavar="N", help="what is drawn (default 1)")
    prove.add_argument("--jobs", type=_count, metavar="N", help="processes at once (default: one a CPU)")
    prove.add_argument("--page", type=Path, metavar="FILE", help="write the page as Markdown here, too")
    _json(prove)


def _bench_verb(verbs: argparse._SubParsersAction[_Parser]) -> None:
    bench = verbs.add_parser(
        "bench",
        help="measure it against others",
        description="accuracy: errors of the offsets against truth, over seeds, scenarios and estimators.",
    )
    bench.add_argument("name", nargs="?", choices=("accuracy",), default="accuracy", metavar="NAME", help="accuracy")
    bench.add_argument("-o", "--output", type=Path, default=Path("out/accuracy"), metavar="DIR", help="keeps trials")
    bench.add_argument("--seeds", type=_count, default=20, metavar="N", help="seeds 1 to N a scenario (default 20)")
    bench.add_argument("--scenario", action="append", default=[], metavar="NAME", help="only this one; may be repeated")
    bench.add_argument("--jobs", type=_count, metavar="N", help="processes at once (default: one a CPU)")
    bench.add_argument("--page", type=Path, metavar="FILE", help="write the tables as Markdown here, not on the screen")
    _json(bench)


def _asking_verbs(verbs: argparse._SubParsersAction[_Parser]) -> None:
    """Those that ask the running daemon."""
    status = verbs.add_parser(
        "status", help="how the running daemon is", description="Asks the running daemon how it is: one answer."
    )
    _socket(status)
    _json(status)

    monitor = verbs.add_parser(
        "monitor",
        help="a live screen of the running daemon",
        description="A live screen of the running daemon (q ends it); in a pipe, a line a channel and look.",
    )
    _socket(monitor)
    monitor.add_argument("--rate", type=_positive, default=4.0, metavar="HZ", help="looks a second (default 4)")

    metrics = verbs.add_parser(
        "metrics",
        help="the running daemon's figures for Prometheus",
        description="Serves the running daemon's figures as Prometheus text at http://HOST:PORT/metrics.",
    )
    _socket(metrics)
    metrics.add_argument("--listen", default="127.0.0.1:9273", metavar="HOST:PORT", help="default 127.0.0.1:9273")


def _install_verb(verbs: argparse._SubParsersAction[_Parser]) -> None:
    install = verbs.add_parser(
        "install-service",
        help="the systemd unit and a first configuration",
        description="Prints the systemd unit and a first configuration for this installation, or writes them.",
    )
    install.add_argument("--write", action="store_true", help="write them (as root); a configuration is never replaced")
    install.add_argument("-c", "--config", type=Path, metavar="CONFIG", help="your configuration, not the example")
    install.add_argument("--instance", metavar="NAME", help="for dsz@NAME with /etc/dsz/NAME.yaml: one of several")
    install.add_argument("--bind", metavar="INTERFACE", help="start and stop with this interface")
    install.add_argument("--realtime", action="store_true", help="allow SCHED_FIFO, locked memory and a CPU of its own")
    install.add_argument("--metrics", action="store_true", help="also the service for Prometheus")
    install.add_argument("--root", type=Path, default=Path("/"), metavar="DIR", help="write below DIR (an image)")
    _json(install)


def _socket(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--socket", type=Path, metavar="PATH", help="the daemon's status socket; else $DSZ_STATUS, /run/dsz/status.sock"
    )


def _config(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("-c", "--config", type=Path, required=True, metavar="CONFIG", help="configuration (YAML)")


def _json(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--json", action="store_true", help="print the summary as JSON to standard output")
