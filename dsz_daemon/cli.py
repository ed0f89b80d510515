"""The command line: parse, call one function, print. Exit codes: 0 done, 2 configuration, 3 input, 4 machine."""

from __future__ import annotations

import argparse
import importlib.util
import json
import os
import sys
from collections.abc import Callable, Sequence
from typing import Any

from dsz_daemon.command_line import parser
from dsz_daemon.errors import DszError, MachineError

EXIT_INTERRUPTED = 130


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
    from dsz_daemon.edge import imports
    from dsz_daemon.runs import screen

    with imports.for_logs(arguments.logs):
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


def _diagnose(arguments: argparse.Namespace) -> int:
    from dsz_daemon.edge import small_arrays
    from dsz_daemon.runs import screen

    small_arrays.before_imports()
    from dsz_daemon.edge import imports

    # Imported where it is needed, and said before anything is computed.
    if importlib.util.find_spec("scipy") is None:
        raise MachineError("diagnose needs scipy, which is not installed: pip install dsz-daemon[desk]")
    with imports.for_logs(arguments.logs):
        from dsz_daemon.runs.diagnose import Beside, diagnose, words
    with screen.progress("diagnose", arguments.json) as progress:
        # As the bar: on a terminal only. The search knows no share done; it says what it is at.
        say = None if progress is None else lambda what: print(what, file=sys.stderr)
        beside = Beside(arguments.reference, arguments.simulation)
        result = diagnose(arguments.logs, arguments.config, arguments.output, progress, say, beside)
    screen.print_warnings(result["source"]["warnings"], ())
    return _show(arguments, result, lambda: print(words(result)))


def _prove(arguments: argparse.Namespace) -> int:
    from dsz_daemon.edge import small_arrays

    small_arrays.before_imports()
    from dsz_daemon.prove.page import results_lines, write_page
    from dsz_daemon.prove.prove import prove
    from dsz_daemon.runs import screen

    with screen.progress("prove", arguments.json) as progress:
        result = prove(arguments.output, arguments.seed, arguments.trials, arguments.jobs, progress)
    for page in (arguments.output / "proof.md", arguments.output / "proof.html", arguments.page):
        if page is not None:
            write_page(result, page)

    def words() -> None:
        for what, reached, bar, holds in results_lines(result["summary"]):
            print(f"{what}: {reached}; {bar}: {holds.strip('*')}")
        print(f"page: {arguments.output / 'proof.html'}")

    return _show(arguments, result, words)


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


_CALLS = {
    "run": _run,
    "replay": _replay,
    "simulate": _simulate,
    "diagnose": _diagnose,
    "prove": _prove,
    "bench": _bench,
    "check": _check,
    "demo": _demo,
    "status": _status,
    "monitor": _monitor,
    "metrics": _metrics,
    "install-service": _install,
}


def main(argv: Sequence[str] | None = None) -> int:
    """Runs one verb; every failure that a user can mend is one message on standard error."""
    code = 0
    try:
        try:
            arguments = parser().parse_args(argv)
            code = _CALLS[arguments.verb](arguments)
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
