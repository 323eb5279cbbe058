"""Superfluous files of the library: their list, a script that removes them, and their move to a folder.

Their owner runs the script, and names the folder. Each file is checked right before it goes: the kept file is
there as another file with its known SHA-256, and the file itself has its own.
"""

import os
import shutil
import stat
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from hashlib import file_digest
from pathlib import Path
from shlex import quote

import typer

from service.client import Client
from service.console import count_of, fail, say
from service.sources.schemas import FileGroup, GroupedFile, Source

SCRIPT = r"""#!/bin/sh
# Removes files of which `isoshape library equal` has found others, DAY.
# Read it, delete the lines of files that shall stay, and run it with sh where the service runs.
#
# equal: the file has the bytes of the kept file.
# merged: its shape was merged into that of the kept file. Its bytes are others: it may be a variant. Without
# it, the merge cannot be undone.
#
# A file goes if it and the kept file are two files that have the SHA-256 of their last scan. It is renamed
# first: if the kept file is gone then, both paths lead to one file, and its name comes back.
set -eu

# Whether a path is that of a file, and leads over no link.
in_place() {
    [ -f "$1" ] && [ ! -L "$1" ] && [ "$(cd -- "${1%/*}" && pwd -P)/${1##*/}" = "$1" ]
}

has() {
    [ "$(sha256sum < "$1")" = "$2  -" ]
}

stays() {
    if [ "$1" = equal ]; then cmp -s -- "$2" "$3"; else has "$3" "$4"; fi
}

# remove equal|merged FILE ITS_SHA256 KEPT_FILE ITS_SHA256
remove() {
    aside=$2.isoshape
    if [ -e "$aside" ] || [ -L "$aside" ]; then
        printf 'left, since %s is there: %s\n' "$aside" "$2"
    elif [ ! -e "$2" ] && [ ! -L "$2" ]; then
        printf 'gone already: %s\n' "$2"
    elif ! in_place "$2" || ! has "$2" "$3"; then
        printf 'left, not the file of the last scan: %s\n' "$2"
    elif [ ! -f "$4" ] || [ "$2" -ef "$4" ] || ! has "$4" "$5"; then
        printf 'left, the kept file is not there as another one: %s\n' "$2"
    elif mv -- "$2" "$aside" && stays "$1" "$aside" "$4" "$5" && rm -f -- "$aside"; then
        printf 'removed: %s\n' "$2"
    else
        if [ -e "$aside" ] && [ ! -e "$2" ] && [ ! -L "$2" ]; then mv -- "$aside" "$2"; fi
        printf 'left: %s\n' "$2"
    fi
}

"""


class _LeftError(Exception):
    """The file stays; the message gives the reason."""


def superfluous(client: Client, source: Source | None, *, merged: bool) -> list[FileGroup]:
    """Return the groups with superfluous files, with those of one source only, or of all."""
    for other in client.sources().sources:
        if other.state != "ready":
            say(f"{other.name} is {other.state}: its files are left out")
    groups = []
    for group in client.equal_files(merged=merged):
        kept, *others = group.files
        wanted = [file for file in others if source is None or file.source_id == source.id]
        if wanted:
            groups.append(FileGroup(files=[kept, *wanted]))
    return groups


def print_groups(groups: Sequence[FileGroup]) -> None:
    """Print groups with an empty line between them, and how much can go."""
    for number, group in enumerate(groups):
        lines = [
            f"{file.role if file.left is None else 'left':<7} {quote(file.path)}"
            + ("" if file.left is None else f"  # {file.left}")
            for file in group.files
        ]
        typer.echo("\n" * (number > 0) + "\n".join(lines))
    files = [file for file, _ in _removable(groups)]
    size = sum(file.bytes for file in files)
    say(f"{count_of(len(files), 'file')} of {size:,} bytes can go; --apply writes a script, or moves them")
    if any(file.role == "merged" for file in files):
        say("the bytes of merged files are others: they may be variants")


def write_script(groups: Sequence[FileGroup], place: str) -> None:
    """Write a shell script that removes the superfluous files; a file that is there is not overwritten."""
    script = SCRIPT.replace("DAY", f"{datetime.now(UTC):%Y-%m-%d %H:%M} UTC")
    for file, kept in _removable(groups):
        words = [file.role, file.path, file.sha256, kept.path, kept.sha256]
        script += f"remove {' '.join(map(quote, words))}\n"
    try:
        with open(place, "xb") as written:
            written.write(os.fsencode(script))
    except OSError as error:
        fail(f"{place}: {error.strerror}")
    say(f"read {place}, then run it with sh on the machine of the service")


def move(client: Client, groups: Sequence[FileGroup], place: str) -> None:
    """Move the superfluous files of this machine below a folder, with their whole paths; print each.

    Status 1 if a file is left.
    """
    files = list(_removable(groups))
    folder = Path(place).resolve()
    wanted = {file.source_id for file, _ in files}
    for source in client.sources().sources:
        root = Path(source.path)
        if source.id in wanted and not root.is_dir():
            fail(f"{root} is not here: move files where the service runs, or use --apply script FILE")
        if any(_same(above, root) for above in (folder, *folder.parents)):
            fail(f"{folder} is in the source {source.name!r}", status=2)
        if any(_same(above, folder) for above in (root, *root.parents)):
            fail(f"the source {source.name!r} is in {folder}", status=2)
    left = False
    for file, kept in files:
        try:
            target = _move(file, kept, folder)
        except (_LeftError, OSError) as error:
            left = True
            say(f"left: {quote(file.path)}: {error}")
        else:
            typer.echo(f"moved {quote(file.path)} to {quote(str(target))}")
    if left:
        raise typer.Exit(1)


def _removable(groups: Sequence[FileGroup]) -> Iterator[tuple[GroupedFile, GroupedFile]]:
    """Yield the files that can go, each with the one that is kept."""
    for group in groups:
        kept, *others = group.files
        yield from ((file, kept) for file in others if file.left is None)


def _move(file: GroupedFile, kept: GroupedFile, folder: Path) -> Path:
    """Move one file, and return its new path.

    Raise _LeftError or OSError if it stays.
    """
    path = Path(file.path)
    target = folder.joinpath(*path.parts[1:])
    before = path.lstat()
    # A link in the path may lead out of the source.
    if not stat.S_ISREG(before.st_mode) or path.resolve() != path:
        raise _LeftError("it is no plain file, or a link leads to it")
    if os.path.samestat(before, os.stat(kept.path)):
        raise _LeftError(f"it is {kept.path} by another path")
    target.parent.mkdir(parents=True, exist_ok=True)
    if not target.parent.resolve().is_relative_to(folder):
        raise _LeftError(f"a link leads out of {folder}")
    _copy(path, target)
    try:
        if not _has(file, target) or _state(path.lstat()) != _state(before):
            raise _LeftError("it is not the file of the last scan")
        if not _has(kept):
            raise _LeftError(f"{kept.path} is not the file of the last scan")
    except BaseException:
        target.unlink()
        raise
    # From here on, the target may be the only file with the bytes.
    try:
        path.unlink()
    except PermissionError:
        target.unlink()
        raise
    try:
        stays = _has(kept)
    except OSError:
        stays = False
    if not stays:
        _copy(target, path)
        target.unlink()
        raise _LeftError(f"it is {kept.path} by another path")
    return target


def _copy(path: Path, target: Path) -> None:
    """Give a file a second path, or copy it to another file system; raise OSError if the path is there."""
    try:
        os.link(path, target)
    except OSError:
        target.touch(exist_ok=False)
        try:
            shutil.copy2(path, target)
            with open(target, "rb") as copy:
                os.fsync(copy)
        except BaseException:
            target.unlink()
            raise


def _has(file: GroupedFile, path: Path | None = None) -> bool:
    """Return whether a file, or another path, has the SHA-256 of a file's last scan."""
    with open(path or file.path, "rb") as content:
        return file_digest(content, "sha256").hexdigest() == file.sha256


def _state(about: os.stat_result) -> tuple[int, ...]:
    return about.st_dev, about.st_ino, about.st_size, about.st_mtime_ns


def _same(path: Path, other: Path) -> bool:
    """Return whether two paths lead to one folder, by a bind mount too."""
    try:
        return path.samefile(other)
    except OSError:
        return path == other
