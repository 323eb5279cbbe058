"""Subsets of large collections."""

from collections import defaultdict
from pathlib import Path


def spread(files: list[tuple[Path, str]], count: int) -> list[tuple[Path, str]]:
    """A subset of the files, over as many classes as can have two files each, in the collection's order.

    The classes are evenly spaced among those with two files or more, by name; each gives its files in
    turn, the first of every class before the second of any. The other classes are drawn on when these have
    no more.
    """
    by_class: dict[str, list[tuple[Path, str]]] = defaultdict(list)
    for file in files:
        by_class[file[1]].append(file)
    large = sorted(name for name, members in by_class.items() if len(members) > 1)
    wanted = min(len(large), max(1, count // 2))
    chosen = [large[i * len(large) // wanted] for i in range(wanted)]
    others = sorted(set(by_class) - set(chosen))
    ordered = _in_turn([by_class[name] for name in chosen]) + _in_turn([by_class[name] for name in others])
    kept = set(ordered[:count])
    return [file for file in files if file in kept]


def _in_turn(lists: list[list[tuple[Path, str]]]) -> list[tuple[Path, str]]:
    depth = max(map(len, lists), default=0)
    return [members[i] for i in range(depth) for members in lists if i < len(members)]
