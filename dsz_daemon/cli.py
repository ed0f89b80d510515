"""The command line: parse, call one function, print. Exit codes: 0 done, 2 configuration, 3 input, 4 machine."""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NoReturn

from dsz_daemon import __version__
from dsz_daemon.errors import ConfigError, DszError

EXIT_INTERRUPTED = 130


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


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="dsz",
        description="Takes the offset errors out of a vehicle's 6-axis IMU, live on CAN or over recordings.",
    )
    parser.add_argument("--version", action="version", version=f"dsz {__version__}")
    verbs = parser.add_subparsers(dest="verb", required=True, metavar="VERB", parser_class=_Parser)

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
    run.set_defaults(call=_run)

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
    replay.set_defaults(call=_replay)

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
    simulate.set_defaults(call=_simulate)

    check = verbs.add_parser(
        "check",
        help="every fault of a configuration at once",
        description="Checks a configuration against its DBC and its own stability; every fault at once.",
    )
    check.add_argument("config", type=Path, metavar="CONFIG")
    _json(check)
    check.set_defaults(call=_check)

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
    demo.set_defaults(call=_demo)
    _bench_verb(verbs)
    _asking_verbs(verbs)
    _install_verb(verbs)
    return parser


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
    bench.set_defaults(call=_bench)


def _asking_verbs(verbs: argparse._SubParsersAction[_Parser]) -> None:
    """Those that ask the running daemon."""
    status = verbs.add_parser(
        "status", help="how the running daemon is", description="Asks the running daemon how it is: one answer."
    )
    _socket(status)
    _json(status)
    status.set_defaults(call=_status)

    monitor = verbs.add_parser(
        "monitor",
        help="a live screen of the running daemon",
        description="A live screen of the running daemon (q ends it); in a pipe, a line a channel and look.",
    )
    _socket(monitor)
    monitor.add_argument("--rate", type=_positive, default=4.0, metavar="HZ", help="looks a second (default 4)")
    monitor.set_defaults(call=_monitor)

    metrics = verbs.add_parser(
        "metrics",
        help="the running daemon's figures for Prometheus",
        description="Serves the running daemon's figures as Prometheus text at http://HOST:PORT/metrics.",
    )
    _socket(metrics)
    metrics.add_argument("--listen", default="127.0.0.1:9273", metavar="HOST:PORT", help="default 127.0.0.1:9273")
    metrics.set_defaults(call=_metrics)


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
    install.set_defaults(call=_install)


def _socket(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--socket", type=Path, metavar="PATH", help="the daemon's status socket; else $DSZ_STATUS, /run/dsz/status.sock"
    )


def _config(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("-c", "--config", type=Path, required=True, metavar="CONFIG", help="configuration (YAML)")


def _json(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--json", action="store_true", help="print the summary as JSON to standard output")


def _show(arguments: argparse.Namespace, summary: dict[str, Any], words: Callable[[], None]) -> int:
    """Prints the summary, as JSON or in words."""
    if arguments.json:
        from dsz_daemon.runs.summary import finite

        print(json.dumps(finite(summary), indent=2))
    else:
        words()
    return EXIT_INTERRUPTED if summary.get("source", {}).get("interrupted") else 0


# Each verb imports what it needs when it is called: `dsz --help` stays quick, and the vehicle
# needs nothing of the desk.
def _run(arguments: argparse.Namespace) -> int:
    from dsz_daemon.edge import realtime
    from dsz_daemon.runs import live, screen, service, setup

    prepared = setup.set_up(arguments.config, arguments.bus, live=True)
    screen.print_warnings(prepared.checked.warnings, prepared.checked.notes)
    options = live.LiveOptions(record=arguments.record, folder=arguments.output, duration_s=arguments.duration)
    paths = service.environment_paths(prepared, arguments.state, arguments.status)
    with service.Service(paths, tuple(arguments.bus)) as surrounding:
        running = live.Live(prepared, options, surrounding)
        wanted = prepared.settings.service
        screen.print_warnings(realtime.be_punctual(wanted.realtime_priority, wanted.lock_memory, wanted.cpu), ())
        realtime.calm_collector()
        summary = running.run()
    return _show(arguments, summary, lambda: screen.print_run(summary, arguments.output))


def _replay(arguments: argparse.Namespace) -> int:
    from dsz_daemon.runs import screen
    from dsz_daemon.runs.replay import replay

    with screen.progress("replay", arguments.json) as progress:
        summary = replay(
            arguments.logs,
            arguments.config,
            arguments.output,
            arguments.speed,
            arguments.to,
            progress,
            arguments.truth,
        )
    return _show(arguments, summary, lambda: screen.print_run(summary, arguments.output))


def _simulate(arguments: argparse.Namespace) -> int:
    from dsz_daemon.runs import screen
    from dsz_daemon.runs.simulate import simulate

    with screen.progress("simulate", arguments.json) as progress:
        summary = simulate(
            arguments.scenario, arguments.output, arguments.seed, progress, arguments.effect, arguments.nominal
        )
    return _show(arguments, summary, lambda: screen.print_simulation(summary))


def _check(arguments: argparse.Namespace) -> int:
    from dsz_daemon.runs import screen, setup

    prepared = setup.set_up(arguments.config)
    checked = prepared.checked
    summary = {
        "config": str(arguments.config),
        "roles": sorted(prepared.roles),
        "warnings": list(checked.warnings),
        "notes": list(checked.notes),
        "settings": prepared.settings.model_dump(mode="json"),
    }

    def words() -> None:
        print(f"{arguments.config}: good; {len(prepared.roles)} signals mapped: {', '.join(sorted(prepared.roles))}")
        screen.print_warnings(checked.warnings, checked.notes, to_stdout=True)

    return _show(arguments, summary, words)


def _demo(arguments: argparse.Namespace) -> int:
    from dsz_daemon.runs import screen
    from dsz_daemon.runs.demo import demo

    with screen.progress("demo", arguments.json) as progress:
        summary = demo(arguments.output, arguments.scenario, arguments.seed, arguments.speed, progress)
    return _show(arguments, summary, lambda: screen.print_run(summary, arguments.output))


def _bench(arguments: argparse.Namespace) -> int:
    from dsz_daemon.runs import accuracy, accuracy_page, screen

    with screen.progress("bench accuracy", arguments.json) as progress:
        result = accuracy.accuracy(arguments.output, arguments.seeds, arguments.scenario, arguments.jobs, progress)
    if arguments.page is not None:
        accuracy_page.write_page(result, arguments.page)

    def words() -> None:
        print(f"{arguments.page}: written" if arguments.page is not None else accuracy_page.page(result))

    return _show(arguments, result, words)


def _status(arguments: argparse.Namespace) -> int:
    from dsz_daemon.runs import asking, screen_status

    answer = asking.answer(asking.socket_path(arguments.socket))
    return _show(arguments, answer, lambda: screen_status.print_status(answer))


def _monitor(arguments: argparse.Namespace) -> int:
    from dsz_daemon.runs import asking, monitor

    monitor.monitor(asking.socket_path(arguments.socket), arguments.rate)
    return 0


def _metrics(arguments: argparse.Namespace) -> int:
    from dsz_daemon.runs import asking, metrics

    metrics.serve_metrics(asking.socket_path(arguments.socket), arguments.listen)
    return 0


def _install(arguments: argparse.Namespace) -> int:
    from dsz_daemon.runs import install, screen

    options = install.InstallOptions(
        config=arguments.config,
        instance=arguments.instance,
        bind=arguments.bind,
        realtime=arguments.realtime,
        metrics=arguments.metrics,
        root=arguments.root,
    )
    summary = install.install(options) if arguments.write else install.shown(options)

    def words() -> None:
        print(install.words(summary))
        screen.print_warnings(summary["warnings"], ())

    return _show(arguments, summary, words)


def main(argv: Sequence[str] | None = None) -> int:
    """Runs one verb; every failure that a user can mend is one message on standard error."""
    code = 0
    try:
        try:
            arguments = _parser().parse_args(argv)
            code = int(arguments.call(arguments))
        except DszError as error:
            code = error.exit_code
            print(f"dsz: {error}", file=sys.stderr)
        except KeyboardInterrupt:
            code = EXIT_INTERRUPTED
            print("dsz: interrupted", file=sys.stderr)
        finally:
            # Python itself would flush too late for a broken pipe to be caught.
            sys.stdout.flush()
    except BrokenPipeError:
        # The reader of our output went away (`dsz ... | head`); nothing is lost but the words.
        for stream in (sys.stdout, sys.stderr):
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
    return code


if __name__ == "__main__":
    raise SystemExit(main())
