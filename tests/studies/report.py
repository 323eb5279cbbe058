"""Print the CSV files of a folder as tables in Markdown: `python -m tests.studies.report DIR`."""

import argparse
import csv
from pathlib import Path


def markdown(path: Path) -> str:
    """Return a CSV file as a table; columns of numbers are right-aligned."""
    with path.open(encoding="utf-8", newline="") as file:
        headings, *rows = csv.reader(file)
    numbers = [all(_is_number(row[i]) for row in rows) for i in range(len(headings))]
    rules = ["---:" if number else "---" for number in numbers]
    return "\n".join("| " + " | ".join(map(_escaped, row)) + " |" for row in (headings, rules, *rows))


def _is_number(text: str) -> bool:
    try:
        float(text or 0)
    except ValueError:
        return False
    return True


def _escaped(text: str) -> str:
    """Return text that Markdown shows as it is: names of files may hold anything."""
    return text.replace("&", "&amp;").replace("<", "&lt;").replace("|", "\\|").replace("\n", " ")


def main(folder: Path) -> None:
    """Print a heading, the table and the pictures of each CSV file."""
    for path in sorted(folder.glob("*.csv")):
        print(f"## {path.stem}\n\n{markdown(path)}\n")
    for path in sorted(folder.glob("*.png")):
        print(f"![{path.stem}]({path.name})\n")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", metavar="DIR", type=Path)
    main(**vars(parser.parse_args()))
