"""Tags of the files of a source by patterns of their paths."""

from collections.abc import Mapping, Sequence

from pathspec import GitIgnoreSpec


class Rules:
    """Rules of tags.

    Parameters
    ----------
    tags : mapping of str to sequence of str
        The tags by patterns in the syntax of .gitignore.

    Raises
    ------
    ValueError
        A pattern is none; the message tells which.
    """

    def __init__(self, tags: Mapping[str, Sequence[str]]) -> None:
        self._rules = []
        for pattern, given in tags.items():
            try:
                spec = GitIgnoreSpec.from_lines([pattern])
            except ValueError as error:
                raise ValueError(f"{pattern!r} is no pattern") from error
            self._rules.append((spec, given))

    def tags_of(self, path: str) -> list[str]:
        """Return the tags of a file by its path from the root of the source."""
        return [tag for spec, tags in self._rules if spec.match_file(path) for tag in tags]
