"""Tags of the files of a source by patterns of their paths."""

from collections.abc import Mapping, Sequence

from pathspec import GitIgnoreSpec

ASTERISKS = 4
"""The most asterisks of a pattern. Each multiplies the time of a match by the length of the path."""

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
        A pattern is none, selects no file, or has too many asterisks; the message tells which.
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
        A pattern is none, or has too many asterisks, or there are too many; the message tells which.
    """
    if len(patterns) > PATTERNS:
        raise ValueError(f"more than {PATTERNS} patterns")
    for pattern in patterns:
        try:
            spec = GitIgnoreSpec.from_lines([pattern])
        except ValueError as error:
            raise ValueError(f"{pattern!r} is no pattern") from error
        asterisks = sum(part == "**" or part.count("*") for part in pattern.split("/"))
        # A comment matches nothing.
        if spec.patterns[0].include is not None and asterisks > ASTERISKS:
            raise ValueError(
                f"{pattern!r} has more than {ASTERISKS} asterisks; ** between slashes counts as one"
            )
    return GitIgnoreSpec.from_lines(patterns)


def _rule(pattern: str) -> GitIgnoreSpec:
    spec = spec_of([pattern])
    # A comment or an exception selects nothing.
    if not spec.patterns[0].include:
        raise ValueError(f"{pattern!r} selects no file")
    return spec
