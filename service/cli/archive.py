"""The file of the archive, and the summary of its contents, for the commands on archives."""

from pathlib import Path

from service.console import output
from service.settings import load_settings
from service.storage.checking import CheckReport
from service.storage.sqlite import path_of


def archive_in_use() -> Path:
    """The file that ISOSHAPE_DATABASE_URL names, or the default file."""
    return path_of(load_settings().database_url)


def print_counts(report: CheckReport) -> None:
    """Print the numbers of shapes, files and embeddings of an archive."""
    console = output()
    console.print(
        f"{report.shapes} shapes on {report.blobs} files of {report.bytes} bytes, "
        f"{report.embeddings} embeddings",
        soft_wrap=True,
    )
    for fingerprint, count in sorted(report.pipelines.items()):
        console.print(f"pipeline {fingerprint}: {count} embeddings", soft_wrap=True)
