"""Effects as words: `NAME` or `NAME:KEY=VALUE,KEY=VALUE` as on the command line, and the vocabulary to read."""

from __future__ import annotations

from collections.abc import Sequence

from dsz_daemon.errors import Fault
from dsz_daemon.sim.effects import EFFECTS, Choice, Parameter, Value

FORM = "NAME or NAME:KEY=VALUE,KEY=VALUE"


def choices(texts: Sequence[str]) -> tuple[list[Choice], list[Fault]]:
    """Return the effects of these texts, and what of them is no effect's form; names and values are as given.

    >>> choices(["imu_delay", "side_wind:rms_n=300"])[0]
    [Choice(name='imu_delay', given={}), Choice(name='side_wind', given={'rms_n': '300'})]
    """
    found: list[Choice] = []
    faults: list[Fault] = []
    for text in texts:
        name, colon, rest = text.partition(":")
        given: dict[str, Value] = {}
        for pair in rest.split(",") if colon else []:
            key, equals, value = (part.strip() for part in pair.partition("="))
            if not (key and equals and value):
                faults.append(Fault(f"--effect {text}", f"{pair!r} is no KEY=VALUE; expected {FORM}"))
            elif key in given:
                faults.append(Fault(f"--effect {text}", f"{key} is there twice; expected one value"))
            else:
                given[key] = value
        found.append(Choice(name.strip(), given))
    return found, faults


_HEAD = """\
Effects: what is true of the simulated car instead of the nominal. The configuration that is written knows none of them.

  dsz simulate SCENARIO -o DIR --effect NAME --effect NAME:KEY=VALUE,KEY=VALUE ...

A name alone has the values below. Once a parameter is given, those that aren't stay as they are in the car, but for
those marked *, which have the value below then, too. In brackets: the bounds. The order of effects does not matter.
"""


def vocabulary() -> str:
    """Return every effect with its statement, parameters, units, defaults and bounds."""
    lines = [_HEAD]
    for effect in EFFECTS.values():
        lines.append(f"{effect.name}{' (may be repeated)' if effect.repeats else ''}: {effect.statement}")
        width = max(map(len, effect.parameters))
        lines += [f"  {key:{width}} {_words(parameter)}" for key, parameter in effect.parameters.items()]
        lines.append("")
    return "\n".join(lines)


def _words(parameter: Parameter) -> str:
    mark = "*" if parameter.always else " "
    if parameter.words:
        return f"{mark} {parameter.words[round(parameter.default or 0.0)]} [{', '.join(parameter.words)}]"
    unit = "" if parameter.unit == "1" else f" {parameter.unit}"
    value = "as it is" if parameter.default is None else f"{parameter.default:g}{unit}"
    return f"{mark} {value} [{parameter.least:g} to {parameter.most:g}{unit}]"
