"""`isoshape library`: folders whose mesh files are shapes and stay where they are."""

import os
import shlex
from collections.abc import Callable
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import typer

from service.cli.service_address import Collection, Key, Url, serves, service_at
from service.cli.superfluous import move, print_groups, superfluous, write_script
from service.client import Client, ProblemError
from service.collection import DEFAULT_COLLECTION
from service.console import count_of, fail, output, progress, say, table
from service.shapes.fields import split_tags
from service.sources.schemas import FileState, NewSource, Source

Action = Literal["list", "add", "rule", "rescan", "confirm", "equal", "remove"]

CHECK_SECONDS = 0.5


def library_command(
    action: Annotated[Action, typer.Argument(help="What to do.")] = "list",
    target: Annotated[
        str | None,
        typer.Argument(metavar="[NAME]", help="A folder to add, or the name, path or id of a source."),
    ] = None,
    *,
    name: Annotated[
        str | None, typer.Option(help="Name of the added source. [default: that of the folder]")
    ] = None,
    tags: Annotated[
        list[str] | None,
        typer.Option("--tags", "--tag", help="Tags of the source's shapes, separated by commas; repeatable."),
    ] = None,
    rule: Annotated[
        list[str] | None,
        typer.Option(
            metavar="PATTERN=TAGS",
            help="Tags of the shapes whose paths meet a pattern in the syntax of .gitignore or, without a "
            "name, whose metadata meet a condition key=value; repeatable.",
        ),
    ] = None,
    copy: Annotated[
        bool, typer.Option("--copy", help="Store the bytes of the files in the archive too.")
    ] = False,
    merged: Annotated[
        bool,
        typer.Option("--merged", help="With `equal`, also the files of shapes that were merged into others."),
    ] = False,
    apply: Annotated[
        tuple[str, str] | None,
        typer.Option(
            metavar="script FILE | move DIR",
            help="With `equal`, write a shell script that removes all but the kept files, or move them to a "
            "folder of this machine.",
        ),
    ] = None,
    url: Url = None,
    key: Key = None,
    collection: Collection = None,
) -> None:
    """List, add, scan and remove folders that stay in place.

    The mesh files of a folder are shapes, and stay where they are; the service writes and deletes none.
    `add` stores them, and `rescan` what has changed since, in one source or in all; `isoshape serve` rescans
    by itself. `rule` sets the rules of a source, by which its shapes are tagged; without a name it sets, or
    lists, those of the collection, by which shapes are tagged by their metadata. A source is offline if its
    folder is absent or empty, or has lost more than half of its files: nothing is deleted then, until
    `confirm` says that the files are gone for good. `equal` prints the files that are there more than once,
    in one source or in all, with an empty line between groups: first the one to keep, then the others, and
    which of them are left in any case. `remove` deletes the shapes of a source; for a time,
    `isoshape restore` brings them back. Scans print the refused files that are new, `list NAME` all of them.

    A service adds folders within its setting ISOSHAPE_SOURCE_ROOTS only. This command adds any folder where
    the service was started, or with the address of a database in --url, or in ISOSHAPE_DATABASE_URL.
    """
    if target is None and action in {"add", "confirm", "remove"}:
        fail(f"library {action} needs a name", status=2)
    if (merged or apply) and action != "equal":
        fail("--merged and --apply are options of library equal", status=2)
    if apply is not None and apply[0] not in {"script", "move"}:
        fail("--apply takes script FILE or move DIR", status=2)
    if action == "rule" and rule is None and target is not None:
        fail("library rule needs --rule; --rule '' takes all rules away", status=2)
    with service_at(url, key, collection, new=action == "add") as client:
        if action == "list":
            listed = client.sources().sources if target is None else [_named(client, target)]
            _print(listed)
            if not listed:
                say("no folders yet; `isoshape library add FOLDER` has the meshes of a folder here")
            for source in listed if target is not None else ():
                for path, reason in _refused(client, source).items():
                    say(f"{path}: {reason}")
        elif action == "add":
            folder = str(Path(target or "").absolute())
            new = NewSource(
                path=folder, name=name, tags=split_tags(tags or []), rules=_rules(rule or []), copies=copy
            )
            _follow(client, [_added(client, new, key, collection)])
        elif action == "rule" and target is None:
            rules = client.rules().rules if rule is None else client.set_rules(_rules(rule)).rules
            listed_rules = table("metadata", "tags")
            for condition, given in rules.items():
                listed_rules.add_row(condition, ", ".join(given))
            output().print(listed_rules)
        elif action == "rule":
            _follow(
                client,
                [_named(client, target or "")],
                partial(client.set_source_rules, rules=_rules(rule or [])),
            )
        elif action == "rescan":
            wanted = client.sources().sources if target is None else [_named(client, target)]
            _follow(client, wanted, client.rescan_source)
        elif action == "confirm":
            _follow(client, [_named(client, target or "")], client.confirm_source)
        elif action == "equal":
            of = None if target is None else _named(client, target)
            groups = superfluous(client, of, merged=merged)
            if apply is None:
                print_groups(groups)
            elif apply[0] == "script":
                write_script(groups, apply[1])
            else:
                move(client, groups, apply[1])
        else:
            client.remove_source(_named(client, target or "").id)


def _added(client: Client, new: NewSource, key: str | None, collection: str | None) -> Source:
    """Add a folder; through the archive if its service, which wants no key, refuses the folder.

    Who may write to the archive may have any folder scanned.
    """
    try:
        return client.add_source(new.path, **new.model_dump(exclude={"path"}))
    except ProblemError as error:
        if error.kind != "source-refused" or key is not None:
            raise
        # Here, so that other actions do not wait for these imports.
        from service.collections import repository as collections  # noqa: PLC0415
        from service.settings import load_settings  # noqa: PLC0415
        from service.sources import service as sources  # noqa: PLC0415
        from service.storage.database import Database  # noqa: PLC0415

        settings = load_settings()
        if not serves(client.url, settings.database_url):
            raise
        root = sources.real_folder(new.path, [os.sep])
        with (
            closing(Database(settings.database_url, lock_seconds=settings.lock_seconds)) as database,
            database.write() as session,
        ):
            number = collections.get(session, collection or DEFAULT_COLLECTION.name).number
            return sources.add(session, number, new, root)


def _rules(rules: list[str]) -> dict[str, list[str]]:
    """Return tags by patterns, from texts of the form PATTERN=TAGS."""
    by_pattern: dict[str, list[str]] = {}
    for rule in filter(None, rules):
        pattern, _, tags = rule.rpartition("=")
        if not (pattern and split_tags([tags])):
            fail(f"--rule {rule}: write a pattern, = and tags", status=2)
        by_pattern.setdefault(pattern, []).extend(split_tags([tags]))
    return by_pattern


def _named(client: Client, target: str) -> Source:
    """Return the source with a name, a path or an id."""
    path = str(Path(target).resolve())
    for source in client.sources().sources:
        if target in {source.name, source.id} or source.path == path:
            return source
    fail(f"there is no source {target!r}; `isoshape library list` lists them")


def _follow(client: Client, sources: list[Source], ask: Callable[[str], Source] | None = None) -> None:
    """Show scans until they have ended, then what the sources have; status 1 if one is offline.

    The scans are asked for, unless they have begun. Files that were refused before that, for the same reason,
    are only counted.
    """
    before: dict[str, dict[str, str]] = {}
    if ask is not None:
        before = {source.id: _refused(client, source) for source in sources}
        sources = [ask(source.id) for source in sources]
    ended = []
    for source in sources:
        with progress() as bar:
            task = bar.add_task(f"scanning {source.name}", total=None)
            for now in client.follow_source(source.id, seconds=CHECK_SECONDS):
                done, total = now.scan.done, now.scan.due
                bar.update(task, description=f"scanning {now.name}", completed=done, total=total or None)
        ended.append(now)
    _print(ended)
    for source in ended:
        known = 0
        for path, reason in _refused(client, source).items():
            if before.get(source.id, {}).get(path) == reason:
                known += 1
            else:
                say(f"{path}: {reason}")
        if known:
            refused = f"{count_of(known, 'file')} refused as before"
            say(f"{source.name}: {refused}; `isoshape library list {shlex.quote(source.name)}`")
    if any(source.state == "offline" for source in ended):
        raise typer.Exit(1)


def _refused(client: Client, source: Source) -> dict[str, str]:
    """Return the reasons why files of a source are no shapes, by their paths."""
    states: tuple[FileState, ...] = ("refused", "unreadable")
    reasons = {
        file.path: file.problem.detail
        for state in states
        for file in client.source_files(source.id, state=state)
        if file.problem is not None
    }
    return {f"{source.path}/{path}": reason for path, reason in (reasons | source.scan.unread).items()}


def _print(sources: list[Source]) -> None:
    listed = table(
        "source", "state", ">present", ">missing", ">refused", "scanned", "folder", fold=("folder",)
    )
    for source in sources:
        counts = source.counts
        scanned = "" if source.scanned_at is None else f"{source.scanned_at:%Y-%m-%d %H:%M}"
        numbers = (counts.present, counts.missing, counts.refused + counts.unreadable)
        listed.add_row(source.name, source.state, *map(str, numbers), scanned, source.path)
    output().print(listed)
    for source in sources:
        if source.detail is not None:
            say(f"{source.name}: {source.detail}")
