"""The file that keeps offsets from one ignition to the next: whole or not there, never half.

One JSON object with format, version, SHA-256 over the body and the body, in the one spelling that
`encoded` gives: whatever differs from it by a single byte is no longer believed. The writer makes
a new file, waits until it is on the disk, moves the old one aside as the previous generation and
the new one into its place: a stop between any two system calls leaves one of them to load.
Only the standard library: the writing process shall start quickly.
"""

from __future__ import annotations

import contextlib
import errno
import hashlib
import json
import os
import re
import stat
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

FORMAT = "dsz-offsets"
VERSION = 1
# Six channels with their sources are some 4 kB; nothing larger is read, whatever lies there.
MAX_BYTES = 64 * 1024
# Of files set aside: enough to see that it happened again, too few to fill a disk.
_KEPT_ASIDE = 3
# Nothing in it is secret, and a workshop shall read it; the unit's UMask= may be stricter.
_MODE = 0o644

Body = dict[str, Any]


class Loaded(NamedTuple):
    """What `load` found: the body or None, what is to be said, and which generation it was.

    `generation`: "current", "previous", or "" where there is no body.
    """

    body: Body | None
    said: tuple[str, ...] = ()
    generation: str = ""


def previous_path(path: Path) -> Path:
    """Where the generation before the current one stands: `offsets.previous.json`."""
    return path.with_name(f"{path.stem}.previous{path.suffix}")


def new_path(path: Path) -> Path:
    """Where a generation stands while it is being written."""
    return path.with_name(f"{path.name}.new")


def lock_path(path: Path) -> Path:
    """What the writing process locks, so that no second one writes the same file."""
    return path.with_name(f"{path.name}.lock")


def encoded(body: Body) -> bytes:
    """The whole file's bytes. ValueError where `body` holds what JSON has no word for, or too much."""
    try:
        text = _canonical(body)
    except (TypeError, RecursionError) as error:
        raise ValueError(f"the state can't be written as JSON: {error}") from None
    digest = hashlib.sha256(text.encode("ascii")).hexdigest()
    data = f'{{"format":"{FORMAT}","version":{VERSION},"sha256":"{digest}","body":{text}}}\n'.encode("ascii")
    if len(data) > MAX_BYTES:
        raise ValueError(f"the state has {len(data)} bytes; expected {MAX_BYTES} at most")
    return data


def _canonical(body: Any) -> str:
    return json.dumps(body, sort_keys=True, separators=(",", ":"), allow_nan=False)


def decoded(data: bytes) -> Body:
    """The body of a whole file's bytes. ValueError, with the reason, for anything that `encoded` did not give."""
    try:
        whole = json.loads(data.decode("ascii"), parse_constant=_no_number)
    except (ValueError, RecursionError):
        raise ValueError("is no JSON text: cut short, changed or another kind of file") from None
    if not isinstance(whole, dict) or whole.get("format") != FORMAT:
        raise ValueError(f"is another kind of file; expected the format {FORMAT!r}")
    if whole.get("version") != VERSION:
        raise ValueError(f"has version {str(whole.get('version'))[:20]}; expected {VERSION}")
    body = whole.get("body")
    try:
        is_whole = isinstance(body, dict) and encoded(body) == data
    except ValueError:
        is_whole = False
    if not is_whole:
        raise ValueError("does not match its checksum: cut short or changed")
    return body  # type: ignore[return-value]  # a dict, or it were not whole


def _no_number(text: str) -> NoReturn:
    raise ValueError(f"{text} is not JSON")


def load(path: Path) -> Loaded:
    """The newest generation that is whole. Never raises for what lies there; a missing file is normal.

    What is not whole is renamed to `NAME.bad1`, `.bad2` and so on (the last few are kept) and said.
    """
    said: list[str] = []
    for generation, candidate in (("current", path), ("previous", previous_path(path))):
        try:
            body = decoded(_content(candidate))
        except FileNotFoundError:
            continue
        except OSError as error:
            said.append(f"{candidate}: can't be read: {error.strerror or error}")
        except ValueError as error:
            said.append(f"{candidate}: {error}; {_set_aside(candidate)}")
        else:
            if generation == "previous":
                why = "" if said else f"{path} is missing; "
                said.append(f"{why}{candidate}, the generation before, is used")
            return Loaded(body, tuple(said), generation)
    return Loaded(None, tuple(said))


def _content(path: Path) -> bytes:
    """The file's bytes, at most MAX_BYTES. OSError, also where it is no file; ValueError where it is too large."""
    # Without O_NONBLOCK a FIFO that lies there would hold us for ever.
    fd = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        if not stat.S_ISREG(os.fstat(fd).st_mode):
            raise OSError(errno.EINVAL, "it is no file")
        data = b""
        while len(data) <= MAX_BYTES and (part := os.read(fd, MAX_BYTES + 1 - len(data))):
            data += part
    finally:
        os.close(fd)
    if len(data) > MAX_BYTES:
        raise ValueError(f"is larger than {MAX_BYTES} bytes: another kind of file")
    return data


def _set_aside(path: Path) -> str:
    """Renames a file that is not whole; says where to, or why it could not be."""
    pattern = re.compile(re.escape(path.name) + r"\.bad([0-9]{1,9})")
    try:
        found = [match for other in path.parent.iterdir() if (match := pattern.fullmatch(other.name))]
        aside = sorted((int(match[1]), match[0]) for match in found)
        number = aside[-1][0] + 1 if aside else 1
        target = path.with_name(f"{path.name}.bad{number}")
        path.rename(target)
        for _, name in aside[: len(aside) + 1 - _KEPT_ASIDE]:
            path.with_name(name).unlink()
    except (OSError, ValueError) as error:
        return f"it can't be set aside: {getattr(error, 'strerror', None) or error}"
    return f"set aside as {target.name}"


def save(path: Path, data: bytes) -> None:
    """Makes `data` (of `encoded`) the current generation, the current one the previous. OSError where it can't."""
    new = new_path(path)
    new.unlink(missing_ok=True)
    fd = os.open(new, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, _MODE)
    try:
        try:
            _write(fd, data)
            os.fsync(fd)
        finally:
            os.close(fd)
        # One that is not whole must not push out the last that is.
        if _is_whole(path):
            path.rename(previous_path(path))
        new.rename(path)
    except OSError:
        with contextlib.suppress(OSError):
            new.unlink()
        raise
    _sync_folder(path.parent)


def _write(fd: int, data: bytes) -> None:
    rest = memoryview(data)
    while rest:
        rest = rest[os.write(fd, rest) :]


def _is_whole(path: Path) -> bool:
    try:
        decoded(_content(path))
    except (OSError, ValueError):
        return False
    return True


def _sync_folder(folder: Path) -> None:
    fd = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        os.fsync(fd)
    except OSError as error:
        # Some file systems (FUSE, network) have no such thing as a folder on the disk.
        if error.errno not in {errno.EINVAL, errno.ENOTSUP}:
            raise
    finally:
        os.close(fd)
