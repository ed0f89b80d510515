"""A small proof from end to end: sealed, answered by another process, opened, scored; no alarm where nothing is."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from dsz_daemon.cli import main
from dsz_daemon.errors import InputError
from dsz_daemon.prove.prove import prove

pytest.importorskip("vehiclemodels", reason="commonroad-vehicle-models is not installed (extra: prove)")

SEED, TRIALS = 7, 10


@pytest.mark.long
def test_a_small_proof(tmp_path: Path) -> None:
    folder = tmp_path / "proof"
    command = ["prove", "-o", str(folder), "--trials", str(TRIALS), "--seed", str(SEED)]
    assert main([*command, "--page", str(tmp_path / "page.md")]) == 0
    scores = json.loads((folder / "scores.json").read_text())
    found = scores["summary"]
    assert found["trials"] == TRIALS
    assert found["errors"] == 0
    assert found["false_alarms"]["of"] >= 2
    assert found["false_alarms"]["hits"] == 0
    plain = [one for one in scores["trials"] if one["group"] in {"single", "pair"} and one["size"] == 1.0]
    assert plain
    assert sum(one["first"] for one in plain) >= 0.5 * len(plain)
    assert (tmp_path / "page.md").read_text() == (folder / "proof.md").read_text()

    # Beginnings were judged, too, before anything was opened.
    lengths = {one["seconds"]: one["of"] for one in found["lengths"]}
    assert set(lengths) == {30.0, 60.0, 100.0, 150.0}
    assert set(lengths.values()) == {sum(one["group"] == "single" and one["size"] == 1.0 for one in scores["trials"])}

    # Sealed before it was answered, and nothing is done again.
    seals, answers = folder / "seal.json", sorted((folder / "answers").glob("*/diagnosis.json"))
    assert seals.stat().st_mtime_ns < min(answer.stat().st_mtime_ns for answer in answers)
    before = [answer.stat().st_mtime_ns for answer in answers]
    assert json.loads(json.dumps(prove(folder, SEED, TRIALS)["summary"])) == found
    assert [answer.stat().st_mtime_ns for answer in answers] == before

    # A truth, a profile or a recording that was changed afterwards is seen, though all is scored already.
    first = min((folder / "sealed").glob("*.json"))
    whole = first.read_text()
    first.write_text(whole.replace('"effects"', '"effects "'))
    with pytest.raises(InputError, match="not what was sealed"):
        prove(folder, SEED, TRIALS)
    first.write_text(whole)
    profiles = first.with_suffix(".parquet")
    bytes_before = profiles.read_bytes()
    profiles.write_bytes(bytes_before + b" ")
    with pytest.raises(InputError, match="not what was sealed"):
        prove(folder, SEED, TRIALS)
    profiles.write_bytes(bytes_before)
    config = folder / "recordings" / "00000" / "config.yaml"
    config.write_text(config.read_text() + "\n")
    with pytest.raises(InputError, match="a recording is not the one"):
        prove(folder, SEED, TRIALS)
