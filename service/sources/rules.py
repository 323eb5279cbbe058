"""Tags of the files of a source by patterns of their paths."""

import re
from collections.abc import Mapping, Sequence

from pathspec import GitIgnoreSpec
from pathspec.patterns.gitignore.spec import GitIgnoreSpecPattern

PATTERNS = 1_000
"""The most patterns of a folder. Each is matched with each path."""


class Rules:
    """Rules of tags.

    Parameters
    ----------
    tags : mapping of str to sequence of str
        The tags by patterns in the syntax of .gitignore.

    Raises
    ------
    ValueError
        A pattern is none, or selects no file; the message tells which.
    """

    def __init__(self, tags: Mapping[str, Sequence[str]]) -> None:
        self._rules = []
        for pattern, given in tags.items():
            self._rules.append((_rule(pattern), given))

    def tags_of(self, path: str) -> list[str]:
        """Return the tags of a file by its path from the root of the source."""
        return [tag for spec, tags in self._rules if spec.match_file(path) for tag in tags]


def spec_of(patterns: Sequence[str]) -> GitIgnoreSpec:
    """Return patterns in the syntax of .gitignore, together.

    Raises
    ------
    ValueError
        A pattern is none, or there are too many; the message tells which.
    """
    if len(patterns) > PATTERNS:
        raise ValueError(f"more than {PATTERNS} patterns")
    spec = []
    for pattern in patterns:
        try:
            compiled = GitIgnoreSpecPattern(pattern)
        except ValueError as error:
            raise ValueError(f"{pattern!r} is no pattern") from error
        if compiled.regex is not None:
            regex = re.compile(_without_retries(compiled.regex.pattern))
            compiled = GitIgnoreSpecPattern(regex, compiled.include)
        spec.append(compiled)
    return GitIgnoreSpec(spec)


_ONE, _ANY, _FOLDERS, _WITHIN = "[^/]", "[^/]*", "(?:/.+)?", "^(?:.+/)?"
"""The regular expressions that pathspec writes for `?`, for `*`, for `/**` and for a leading `**/`."""


def _without_retries(regex: str) -> str:
    """Return the regular expression of a pattern with atomic groups, which change no answer.

    Of the text between two asterisks, the first place in a name leaves the most to the others, and so do the
    first folders of those between two `**`. No other is tried: the time of a match would be multiplied by the
    length of the path for each asterisk.
    """
    first, *others = (_first_places(part) for part in regex.split(_FOLDERS))
    if not others:
        return first
    if first.startswith(_WITHIN):
        first = f"^(?>(?:.+?/)??{first.removeprefix(_WITHIN)}(?=/))"
    *middle, last = others
    return "".join([first, *(f"(?>(?:/.+?)??{part}(?=/))" for part in middle), _FOLDERS, last])


def _first_places(regex: str) -> str:
    """Return a part between two `**`, with the texts between the asterisks of a name as atomic groups."""
    first, *others = regex.split(_ANY)
    if not others:
        return first
    *middle, last = others
    groups = (f"{_ANY}{part}" if "/" in part.replace(_ONE, "") else f"(?>{_ANY}?{part})" for part in middle)
    return "".join([first, *groups, _ANY, last])


def _rule(pattern: str) -> GitIgnoreSpec:
    spec = spec_of([pattern])
    # A comment or an exception selects nothing.
    if not spec.patterns[0].include:
        raise ValueError(f"{pattern!r} selects no file")
    return spec
