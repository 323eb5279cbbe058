"""Measured tables on the pages of docs/: each stands between two comments that bear its name."""

from pathlib import Path


def put(page: Path, name: str, text: str) -> None:
    """Have a page hold this text between its lines `<!-- name -->` and `<!-- /name -->`.

    Raises
    ------
    ValueError
        The page does not have each of the two lines once, in that order.
    """
    begin, end = f"<!-- {name} -->\n", f"<!-- /{name} -->\n"
    before, *rest = page.read_text(encoding="utf-8").split(begin)
    parts = rest[0].split(end) if len(rest) == 1 else []
    if len(parts) != 2:
        raise ValueError(f"{page} has no one place for {name}")
    page.write_text(f"{before}{begin}\n{text.strip()}\n\n{end}{parts[1]}", encoding="utf-8")
