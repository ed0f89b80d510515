"""The page of `dsz prove`: Markdown, written by the command alone; failures first."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from dsz_daemon.errors import MachineError
from dsz_daemon.prove.missed import missed
from dsz_daemon.prove.mix import AS_PUBLISHED, SECONDS
from dsz_daemon.prove.third_party_car import BY_CONSTRUCTION
from dsz_daemon.prove.unlisted import UNLISTED
from dsz_daemon.report.proof_page import proof_page

Scores = Sequence[Mapping[str, Any]]

_HEAD = """# The proof

Written by

    dsz prove -o out/proof --trials {trials} --seed {seed} --page docs/proof.md

with dsz {version} (judge {judge}). Do it again with a seed of your own: the shares should stand inside these intervals.

## Protocol

1. The seed draws {trials} recordings of {seconds:g} s: {nulls} with nothing left out (half of them with stiffnesses
   that are off within their tolerance, half with coloured noise), {singles} with one effect of the vocabulary, {pairs}
   with two, {alias_pairs} with two that turn a car alike, {local} with a slippery stretch, {unlisted} with physics that
   the vocabulary has no name for, {shaken} with one effect in a car that shakes itself (below).
2. They are driven by two cars that share no formula with the diagnosis: the project's simulated car (another car and
   another way each time, several other effects on it at a hundredth of their plain size) and CommonRoad's multi-body
   car (29 states, M. Althoff and G. Wuersching, 2020) with its body on springs, load transfer, the Magic Formula and
   slipping wheels. Of that car nothing is ever "nothing": {construction} are always true of it, and
   naming them, or a shape, is no mistake there. What is planted in it are sensors, steering, wheels, road and wind.
   Four numbers of its tyres are 0, by which a tyre without slip pushes to one side or the other by its camber's sign:
   straight ahead they shake that car at 1.6 Hz for ever. With them, as published, it is counted by itself
   ([decision 0020](decisions/0020-a-car-that-shakes-itself.md)).
3. Truths are written to a folder of their own, each with a salt, and their hashes and those of the recordings to
   `seal.json`. The thresholds and settings of the judge are its sources, whose hash is in `protocol.json`.
4. Another process is given a folder with recording, DBC and configuration at a time, and nothing else.
5. Recordings and seals are checked against the published hashes, opened, and scored. *Right* is a single whose planted
   effect is the first that is named; *or an alias* allows for what is said to be indistinguishable. Intervals are
   Wilson's, 95 %.

Sizes: 1 is what `dsz simulate --effect NAME` alone has; 0.3 and 0.1 are so much nearer to nothing. What these would be
nothing of is drawn at size 1 alone: `sensor_saturation` (no drive gets to the limit) and `cornering_stiffness` (within
what is configured as its tolerance). Of two that turn a car alike each makes it turn less: a load is in front.

Real recordings are pooled with none of this: faults put into the payloads of one, and what was measured and is hidden
from the tool, are in [diagnose.md](diagnose.md), as is what the ways of the judge are worth (ablations).
"""


class _Bar(NamedTuple):
    """What is asked of a share, or of a mean; `upper` of its interval's end."""

    key: str
    words: str
    least: float = 0.0
    most: float = 1.0
    upper: float = 1.0

    def asked(self) -> str:
        """The bar in words."""
        parts = [f"at least {self.least:g}"] if self.least > 0.0 else []
        parts += [f"at most {self.most:g}"] if self.most < 1.0 else []
        return ", ".join(parts + ([f"surely at most {self.upper:g}"] if self.upper < 1.0 else []))

    def holds(self, value: float, high: float = 0.0) -> str:
        """Whether it is reached."""
        return "yes" if self.least <= value <= self.most and high <= self.upper else "**no**"


_SHARES = (
    _Bar("false_alarms", "false alarms on nulls", most=0.01, upper=0.02),
    _Bar("singles_1", "singles of size 1: the effect first", 0.95),
    _Bar("singles_or_alias_1", "... or an alias of it", 0.95),
    _Bar("singles_0.3", "singles of size 0.3: the effect first", 0.95),
    _Bar("singles_0.1", "singles of size 0.1: the effect first", 0.7),
    _Bar("singles_wrong_1", "singles of size 1 with a wrong name instead", most=0.0),
    _Bar("singles_wrong_0.3", "singles of size 0.3 with a wrong name instead", most=0.0),
    _Bar("singles_wrong_0.1", "singles of size 0.1 with a wrong name instead", most=0.0),
    _Bar("both_of_a_pair", "pairs: both named", 0.85),
    _Bar("alias_pairs", "alias pairs: one of them, or what says that it is one of them", 0.85),
    _Bar("false_extras", "answers with a name too many", most=0.02),
    _Bar("shapes_too_many", "own car, named physics: answers with a shape too many", most=0.02),
    _Bar("unlisted_misnamed", "unlisted physics given a name", most=0.02),
    _Bar("unlisted_found", "unlisted physics found in its channel", 0.9),
    _Bar("inside_95", "parameters inside their 95 % interval", 0.92, 0.98),
    _Bar("profile_within_0.1_deg", "road profiles within 0.1 deg rms", 0.95),
    _Bar("overlap_0.7", "slippery stretches located with an overlap of 0.7", 0.9),
)
_MEANS = (
    _Bar("probability_of_truth", "mean probability given to the truth", 0.9),
    _Bar("probability_or_alias", "... or to what is said to be the same on that drive", 0.9),
    _Bar("regained_median", "closable gap regained on unseen data, median", 0.9),
    _Bar("brier", "Brier score of the stated probabilities", most=0.05),
)


def page(result: Mapping[str, Any]) -> str:
    """The whole page of what `prove` returned."""
    scores: Scores = result["trials"]
    protocol, summary = result["protocol"], result["summary"]
    groups = Counter(one["group"] for one in scores)
    head = _HEAD.format(
        trials=protocol["trials"],
        seed=protocol["seed"],
        version=protocol["version"],
        judge=protocol["judge"][:12],
        seconds=SECONDS,
        nulls=groups["null"],
        singles=groups["single"],
        pairs=groups["pair"],
        alias_pairs=groups["alias_pair"],
        local=groups["local"],
        unlisted=groups["unlisted"],
        shaken=groups[AS_PUBLISHED],
        construction=", ".join(f"`{name}`" for name in sorted(BY_CONSTRUCTION)),
    )
    sections = {
        "Results": _results(summary),
        "Where bars are missed": missed(scores),
        "Against the length of the recording": _lengths(summary),
        "Rivals": _rivals(summary),
        "Failures": _failures(scores),
        "By effect": _by_effect(scores),
        "One for another": _confusion(summary),
        "What has no name": _nameless(scores),
        "Every trial": _every(scores),
    }
    return "\n".join([head, *(f"## {name}\n\n{text}" for name, text in sections.items())])


def write_page(result: Mapping[str, Any], path: Path) -> None:
    """As Markdown, or as HTML by its name. MachineError where it can't be drawn or written."""
    try:
        if path.suffix == ".html":
            failed = [one for one in result["trials"] if is_failure(one)]
            path.write_bytes(proof_page(result, results_lines(result["summary"]), failed))
        else:
            path.write_text(page(result), encoding="utf-8")
    except OSError as error:
        raise MachineError(f"{path}: can't write the page: {error.strerror or error}") from error


def results_lines(summary: Mapping[str, Any]) -> list[tuple[str, str, str, str]]:
    """Each figure in words: what, reached (with its interval), bar, whether it holds."""
    lines = []
    for bar in _SHARES:
        one = summary.get(bar.key)
        if one is None or not one["of"]:
            continue
        share = one["hits"] / one["of"]
        figure = f"{one['hits']} of {one['of']} = {share:.3f} ({one['low']:.3f} to {one['high']:.3f})"
        lines.append((bar.words, figure, bar.asked(), bar.holds(share, one["high"] if bar.upper < 1.0 else 0.0)))
    means = ((bar, summary[bar.key]) for bar in _MEANS)
    lines += [(bar.words, f"{mean:.3f}", bar.asked(), bar.holds(mean)) for bar, mean in means if mean is not None]
    return lines


def _results(summary: Mapping[str, Any]) -> str:
    rows = ["| | reached | bar | holds |", "|---|---|---|---|"]
    rows += [f"| {' | '.join(line)} |" for line in results_lines(summary)]
    of_cars = [
        f"{car}: {one['singles']['hits']} of {one['singles']['of']} plain singles right, "
        f"{one['false_extras']['hits']} of {one['false_extras']['of']} answers with a name too many"
        for car, one in summary["by_car"].items()
    ]
    shaken, more = summary["as_published"], summary["as_published_extras"]
    of_cars += [
        f"third_party as published, which shakes itself (in no other figure): {shaken['hits']} of {shaken['of']} "
        f"plain singles right, {more['hits']} of {more['of']} answers with a name too many"
    ]
    stated = [
        "",
        "Stated probability against how often it was right:",
        "",
        "| stated | right | causes |",
        "|---|---|---|",
    ]
    stated += [f"| {one['stated']:.2f} | {one['right']:.2f} | {one['of']} |" for one in summary["reliability"]]
    half, longest = summary["seconds_median"], summary["seconds_longest"]
    seconds = "" if half is None else f"Half of the diagnoses took less than {half:.0f} s, the longest {longest:.0f} s."
    begins, ends = summary["begins_off_s"], summary["ends_off_s"]
    moments = "" if begins is None else f"Slippery stretches begin {begins:.1f} s and end {ends:.1f} s off (median). "
    return "\n".join([*rows, "", ". ".join(of_cars) + ".", *stated, "", moments + seconds, ""])


def _lengths(summary: Mapping[str, Any]) -> str:
    """Of the same trials, the first part alone."""
    words = "Of the first plain singles the judge was given the beginning alone, too, before any seal was opened."
    rows = ["| driven | the effect first |", "|---|---|"]
    for one in summary["lengths"]:
        right = f"{one['hits']} of {one['of']} = {one['hits'] / one['of']:.3f} ({one['low']:.3f} to {one['high']:.3f})"
        rows.append(f"| {one['seconds']:g} s | {right} |")
    return "\n".join([words, "", *rows, ""]) if summary["lengths"] else "None.\n"


def _confusion(summary: Mapping[str, Any]) -> str:
    """Singles of any size by what was said first, where that is another."""
    other = [row for row in summary["confusion"] if row[0] != row[1]]
    if not other:
        return "None.\n"
    words = "Singles of any size of which something else was said first, or nothing; `By effect` has the others."
    rows = ["| planted | said first | how often |", "|---|---|---|"]
    rows += [f"| {planted} | {said} | {count} |" for planted, said, count in other]
    return "\n".join([words, "", *rows, ""])


def _rivals(summary: Mapping[str, Any]) -> str:
    """Others, on the same recordings."""
    rows = ["| who | singles of any size: the effect first | false alarms | closable gap regained, median |"]
    rows.append("|---|---|---|---|")
    for one in summary["rivals"]:
        first, alarms = (f"{part['hits']} of {part['of']}" for part in (one["first"], one["false_alarms"]))
        regained = "-" if one["regained"] is None else f"{one['regained']:.2f}"
        rows.append(f"| {one['name']} | {first} | {alarms} | {regained} |")
    return "\n".join([*rows, ""])


def is_failure(one: Mapping[str, Any]) -> bool:
    """Whether something was said that is not so, or nothing of what is plain."""
    if one["error"] or (one["alarm"] and one["group"] == "null") or one["extra"]:
        return True
    if one["group"] in {"single", AS_PUBLISHED}:
        return one["size"] == 1.0 and not one["first"]
    return one["group"] == "pair" and not one["all_named"]


def _failures(scores: Scores) -> str:
    failed = [one for one in scores if is_failure(one)]
    if not failed:
        return "None.\n"
    where = "The reason is what the answer itself tells of each effect that was not named, and of each name too many.\n"
    where += "What is behind them, as far as it is known: [diagnose.md](diagnose.md), What it can't yet.\n"
    heads = (f"{_TRIAL_HEAD[0]} reason |", f"{_TRIAL_HEAD[1]}---|")
    return "\n".join([where, *heads, *(f"{_row(one)} {'; '.join(one['why'])} |" for one in failed), ""])


_TRIAL_HEAD = ("| trial | car, way | planted | said | too much |", "|---|---|---|---|---|")


def _row(one: Mapping[str, Any]) -> str:
    planted = " + ".join([*one["planted"], *(f"(no name: {name})" for name in one["unlisted"])]) or "nothing"
    size = f" at {one['size']:g}" if one["size"] != 1.0 else ""
    said = one["error"] or ", ".join([*one["named"], *one["shapes"]]) or one["verdict"]
    car = one["car"].replace("_", " ") + (" as published" if one["group"] == AS_PUBLISHED else "")
    return f"| {one['number']} | {car}, {one['kind']} | {planted}{size} | {said} | {', '.join(one['extra'])} |"


def _by_effect(scores: Scores) -> str:
    """Singles by effect and size: right / alias / nothing / wrong."""
    sizes = sorted({one["size"] for one in scores if one["group"] == "single"}, reverse=True)
    rows = [f"| effect | {' | '.join(f'size {size:g}' for size in sizes)} |", "|---|" + "---|" * len(sizes)]
    names = sorted({one["planted"][0] for one in scores if one["group"] == "single"})
    for name in names:
        cells = []
        for size in sizes:
            mine = [
                one for one in scores if one["group"] == "single" and one["size"] == size and one["planted"] == [name]
            ]
            counts = Counter(_verdict(one) for one in mine)
            cells.append(", ".join(f"{count} {words}" for words, count in counts.items()) or "-")
        rows.append(f"| {name} | {' | '.join(cells)} |")
    return "\n".join([*rows, ""])


def _verdict(one: Mapping[str, Any]) -> str:
    if one["first"]:
        return "right" if not one["extra"] else "right and more"
    if one["first_or_alias"]:
        return "alias"
    return f"**{', '.join(one['extra'])}**" if one["extra"] else "nothing"


def _nameless(scores: Scores) -> str:
    rows = ["| what | channel | found | misnamed | trials |", "|---|---|---|---|---|"]
    for name, row in UNLISTED.items():
        mine = [one for one in scores if name in one["unlisted"]]
        found, misnamed = sum(one["unlisted_found"] for one in mine), sum(bool(one["extra"]) for one in mine)
        rows.append(f"| {row.words} | {row.channel} | {found} | {misnamed} | {len(mine)} |")
    return "\n".join([*rows, ""])


def _every(scores: Scores) -> str:
    return "\n".join([*_TRIAL_HEAD, *(_row(one) for one in scores), ""])
