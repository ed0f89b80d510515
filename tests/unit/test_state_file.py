"""The state file: whatever happens to it, a whole generation is found or nothing is."""

from __future__ import annotations

import errno
import hashlib
import json
import os
from pathlib import Path

import pytest
from state_cases import Disk, Stopped, body, fill, mounted, ordinary_user

from dsz_daemon.edge.state_file import MAX_BYTES, decoded, encoded, load, new_path, previous_path, save

# `printf '{"a":1}' | sha256sum`
KNOWN = (
    b'{"format":"dsz-offsets","version":1,'
    b'"sha256":"015abd7f5cc57a2dd94b7590f04ad8084273905ee33ec5cebeae62276a97f862","body":{"a":1}}\n'
)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "offsets.json"


def saved(path: Path, *numbers: int) -> None:
    for n in numbers:
        save(path, encoded(body(n)))


def names(path: Path) -> set[str]:
    return {other.name for other in path.parent.iterdir()}


def test_the_format_stays_as_it_is() -> None:
    """A file of an older daemon must be read by a newer one."""
    assert encoded({"a": 1}) == KNOWN
    assert decoded(KNOWN) == {"a": 1}


def test_it_is_json_with_a_checksum_over_the_body() -> None:
    data = encoded(body(3))
    whole = json.loads(data)
    text = data.decode().split('"body":', 1)[1][:-2]
    assert json.loads(text) == whole["body"] == body(3)
    assert whole["sha256"] == hashlib.sha256(text.encode()).hexdigest()


def test_what_is_saved_is_loaded_to_the_last_bit(path: Path) -> None:
    saved(path, 1)
    loaded = load(path)
    assert repr(loaded.body) == repr({key: body(1)[key] for key in sorted(body(1))})
    assert loaded.said == ()
    assert loaded.generation == "current"


def test_nothing_there_is_normal(path: Path) -> None:
    assert load(path) == (None, (), "")
    assert load(path.parent / "no folder" / "offsets.json") == (None, (), "")


def test_one_generation_is_kept_and_no_more(path: Path) -> None:
    saved(path, 1, 2, 3)
    assert names(path) == {"offsets.json", "offsets.previous.json"}
    assert decoded(previous_path(path).read_bytes()) == body(2)
    assert decoded(path.read_bytes()) == body(3)


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf"), {1, 2}, b"x", object()])
def test_what_json_has_no_word_for_is_not_saved(value: object) -> None:
    with pytest.raises(ValueError, match=r"JSON|compliant"):
        encoded({"x": value})


def test_what_would_not_be_loaded_is_not_saved() -> None:
    deep: list[object] = []
    for _ in range(100_000):
        deep = [deep]
    with pytest.raises(ValueError, match="recursion"):
        encoded({"x": deep})
    with pytest.raises(ValueError, match=f"expected {MAX_BYTES} at most"):
        encoded({"x": "x" * MAX_BYTES})


def test_cut_at_every_byte(path: Path) -> None:
    saved(path, 1, 2)
    data = path.read_bytes()
    for length in range(len(data)):
        path.write_bytes(data[:length])
        loaded = load(path)
        assert loaded.body == body(1), length
        assert loaded.generation == "previous"
        assert "set aside as offsets.json.bad" in loaded.said[0]
        assert not path.exists()


def test_every_byte_changed(path: Path) -> None:
    saved(path, 1, 2)
    data = path.read_bytes()
    for place, byte in enumerate(data):
        for other in {byte ^ 1, byte ^ 0x20, byte ^ 0x80, 0, ord("0"), ord(" ")} - {byte}:
            changed = data[:place] + bytes([other]) + data[place + 1 :]
            with pytest.raises(ValueError, match=r"checksum|JSON|format|version"):
                decoded(changed)
            path.write_bytes(changed)
            loaded = load(path)
            assert loaded.body == body(1), (place, other)


BAD = {
    "empty": b"",
    "foreign": b"\x89PNG\r\n\x1a\n" + bytes(range(256)),
    "other JSON": b'{"format":"something else"}\n',
    "no object": b"[1, 2]\n",
    "null": b"null",
    "later version": KNOWN.replace(b'"version":1', b'"version":2'),
    "version true": KNOWN.replace(b'"version":1', b'"version":true'),
    "no version": KNOWN.replace(b'"version":1,', b""),
    "NaN": KNOWN.replace(b'{"a":1}', b'{"a":NaN}'),
    "infinite": KNOWN.replace(b'{"a":1}', b'{"a":1e999}'),
    "long number": KNOWN.replace(b'{"a":1}', b'{"a":' + b"1" * 5000 + b"}"),
    "nested": b"[" * (MAX_BYTES - 1),
    "nested body": KNOWN.replace(b'{"a":1}', b'{"a":' * 10_000 + b"1" + b"}" * 10_000),
    "no body": KNOWN.replace(b',"body":{"a":1}', b""),
    "body is a list": KNOWN.replace(b'{"a":1}', b"[]"),
    "no newline": KNOWN[:-1],
    "twice": KNOWN + KNOWN,
    "something behind": KNOWN + b"\n",
    "another spelling": KNOWN.replace(b'{"a":1}', b'{"a": 1}'),
    "a key twice": KNOWN.replace(b'"version":1,', b'"version":7,"version":1,'),
    "UTF-16": KNOWN.decode().encode("utf-16"),
    "too large": KNOWN + b" " * MAX_BYTES,
    "much too large": b"\0" * (4 * MAX_BYTES),
}


@pytest.mark.parametrize("kind", BAD)
def test_a_bad_file_is_set_aside_and_the_generation_before_is_used(path: Path, kind: str) -> None:
    saved(path, 1, 2)
    path.write_bytes(BAD[kind])
    loaded = load(path)
    assert loaded.body == body(1)
    assert loaded.generation == "previous"
    assert len(loaded.said) == 2
    assert str(path) in loaded.said[0]
    assert (path.parent / "offsets.json.bad1").read_bytes() == BAD[kind]
    saved(path, 3)
    assert load(path) == (body(3), (), "current")


@pytest.mark.parametrize("kind", BAD)
def test_both_generations_bad(path: Path, kind: str) -> None:
    path.write_bytes(BAD[kind])
    previous_path(path).write_bytes(BAD[kind])
    loaded = load(path)
    assert loaded.body is None
    assert len(loaded.said) == 2
    assert names(path) == {"offsets.json.bad1", "offsets.previous.json.bad1"}
    assert load(path) == (None, (), "")


def test_the_last_three_set_aside_are_kept(path: Path) -> None:
    (path.parent / "offsets.json.bad7x").touch()
    (path.parent / "offsets_json.bad9").touch()
    for n in range(12):
        path.write_text(f"bad {n}")
        assert "set aside" in load(path).said[0]
    aside = {name for name in names(path) if name.startswith("offsets.json.bad")} - {"offsets.json.bad7x"}
    assert aside == {"offsets.json.bad10", "offsets.json.bad11", "offsets.json.bad12"}
    assert (path.parent / "offsets.json.bad12").read_text() == "bad 11"


def test_the_generation_before_alone_is_used_and_said(path: Path) -> None:
    saved(path, 1, 2)
    path.unlink()
    loaded = load(path)
    assert loaded.body == body(1)
    assert "offsets.json is missing" in loaded.said[0]


def test_a_folder_in_its_place_is_said(path: Path) -> None:
    saved(path, 1, 2)
    path.unlink()
    path.mkdir()
    loaded = load(path)
    assert loaded.body == body(1)
    assert "it is no file" in loaded.said[0]
    with pytest.raises(OSError, match=r"Is a directory"):
        saved(path, 3)
    assert load(path).body == body(1)
    assert not new_path(path).exists()


def test_nobody_waits_for_a_fifo(path: Path) -> None:
    os.mkfifo(path)
    loaded = load(path)
    assert loaded.body is None
    assert "it is no file" in loaded.said[0]


def test_a_path_that_can_be_none_is_said(path: Path) -> None:
    path.write_text("a file where a folder should be")
    for odd in (path / "offsets.json", path.with_name("x" * 300), path.with_name("a\0b")):
        loaded = load(odd)
        assert loaded.body is None
        assert loaded.said


def test_what_may_not_be_read_is_said() -> None:
    with ordinary_user() as folder:
        path = folder / "offsets.json"
        saved(path, 1, 2)
        path.chmod(0)
        loaded = load(path)
        assert loaded.body == body(1)
        assert "can't be read: Permission denied" in loaded.said[0]


def test_a_folder_that_may_not_be_written() -> None:
    """A bad file can't be set aside then: said, and the generation before is used all the same."""
    with ordinary_user() as folder:
        path = folder / "offsets.json"
        saved(path, 1, 2)
        path.write_text("bad")
        folder.chmod(0o555)
        for _ in range(2):
            loaded = load(path)
            assert loaded.body == body(1)
            assert "it can't be set aside: Permission denied" in loaded.said[0]
        with pytest.raises(PermissionError):
            saved(path, 3)
        folder.chmod(0o755)
        saved(path, 4)
        assert load(path).body == body(4)
        assert decoded(previous_path(path).read_bytes()) == body(1)


def test_a_disk_that_has_become_read_only(tmp_path: Path) -> None:
    with mounted(tmp_path, 1 << 20) as set_read_only:
        path = tmp_path / "offsets.json"
        saved(path, 1, 2)
        path.write_text("bad")
        set_read_only(True)
        loaded = load(path)
        assert loaded.body == body(1)
        assert "it can't be set aside: Read-only file system" in loaded.said[0]
        with pytest.raises(OSError, match="Read-only file system"):
            saved(path, 3)


def test_a_full_disk(tmp_path: Path) -> None:
    with mounted(tmp_path, 16 * 4096):
        path, filler = tmp_path / "offsets.json", tmp_path / "filler"
        saved(path, 1, 2)
        fill(filler)
        with pytest.raises(OSError, match="No space"):
            saved(path, 3)
        assert names(path) == {"offsets.json", "offsets.previous.json", "filler"}
        assert load(path) == (body(2), (), "current")
        filler.unlink()
        saved(path, 4)
        assert load(path).body == body(4)


def calls_of_a_save(path: Path) -> list[tuple[str, str]]:
    with pytest.MonkeyPatch.context() as patch:
        disk = Disk(patch, path.parent)
        saved(path, 9)
    return disk.log


def test_the_new_generation_is_on_the_disk_before_it_gets_its_name(path: Path) -> None:
    """Or a power cut leaves a name without what it stands for."""
    saved(path, 1)
    calls = [call for call in calls_of_a_save(path) if call[0] not in {"close", "open"}]
    assert calls == [
        ("write", "offsets.json.new"),
        ("fsync", "offsets.json.new"),
        ("rename", "offsets.json"),
        ("rename", "offsets.json.new"),
        ("fsync", "."),
    ]


@pytest.mark.parametrize("before", [(), (1,), (1, 2)])
@pytest.mark.parametrize("litter", [False, True])
def test_a_stop_between_any_two_calls_leaves_a_generation(
    tmp_path: Path, before: tuple[int, ...], litter: bool
) -> None:
    """The last one or the new one, never an older one, and the next save works as ever."""
    seen = set()
    for n in range(100):
        path = tmp_path / str(n) / "offsets.json"
        path.parent.mkdir()
        saved(path, *before)
        if litter:
            new_path(path).write_text("half of an earlier attempt")
        with pytest.MonkeyPatch.context() as patch:
            disk = Disk(patch, path.parent)
            disk.stop_before, disk.write_only = n, 100
            try:
                saved(path, 9)
                stopped = False
            except Stopped:
                stopped = True
        disk.close_all()
        loaded = load(path)
        last = body(before[-1]) if before else None
        assert loaded.body in (last, body(9)), n
        assert not [words for words in loaded.said if "set aside" in words]
        seen.add(None if loaded.body is None else loaded.body["n"])
        saved(path, 10)
        assert load(path) == (body(10), (), "current")
        if not stopped:
            break
    assert n >= 8
    assert seen == {before[-1] if before else None, 9}


@pytest.mark.parametrize("written", range(0, 200, 7))
def test_a_stop_within_the_write(path: Path, written: int) -> None:
    saved(path, 1)
    with pytest.MonkeyPatch.context() as patch:
        disk = Disk(patch, path.parent)
        disk.stop_before = 100
        saved(path, 2)
        disk.stop_before = next(i for i, call in enumerate(disk.log) if call[0] == "write")
        disk.log.clear()
        disk.write_only = written
        with pytest.raises(Stopped):
            saved(path, 3)
    disk.close_all()
    assert new_path(path).stat().st_size == written
    assert load(path) == (body(2), (), "current")


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EIO, errno.EROFS, errno.EDQUOT, errno.EACCES])
def test_any_call_may_fail(tmp_path: Path, number: int) -> None:
    for n in range(100):
        path = tmp_path / str(n) / "offsets.json"
        path.parent.mkdir()
        saved(path, 1, 2)
        with pytest.MonkeyPatch.context() as patch:
            disk = Disk(patch, path.parent)
            disk.fail_at = (n, number)
            failed = None
            try:
                saved(path, 9)
            except OSError as error:
                failed = error.errno
        assert failed in {None, number}
        has_failed = len(disk.log) > n
        assert load(path).body in (body(2), body(9)), n
        if failed is not None:
            assert not new_path(path).exists()
        saved(path, 10)
        assert load(path).body == body(10)
        if not has_failed:
            break
    assert n >= 8


def test_what_is_not_whole_does_not_push_out_what_is(path: Path) -> None:
    saved(path, 1, 2)
    path.write_text("spoilt while the daemon ran")
    saved(path, 3)
    assert decoded(previous_path(path).read_bytes()) == body(1)
    assert decoded(path.read_bytes()) == body(3)


def test_a_link_in_the_new_ones_place_is_not_followed(path: Path) -> None:
    victim = path.parent / "victim"
    victim.write_text("untouched")
    new_path(path).symlink_to(victim)
    saved(path, 1)
    assert victim.read_text() == "untouched"
    assert load(path).body == body(1)
