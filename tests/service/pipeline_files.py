"""Another pipeline than the default, and what the embeddings in a database are of."""

from pathlib import Path

from core.parameters import Parameters
from service.settings import load_parameters
from tests.service.engines import rows


def write_parameters(folder: Path) -> Parameters:
    """Parameters called "few", which are in the file few.json of a folder."""
    path = folder / "few.json"
    path.write_text('{"sampling": {"samples": 40, "points": 100}, "matching": {"search_samples": 20}}')
    return load_parameters(str(path))


def embeddings(folder: Path) -> list[tuple[int, str]]:
    """The numbers of the embeddings in a folder's archive, and the pipelines that made them."""
    found = rows(folder, "SELECT number, fingerprint FROM embeddings ORDER BY number")
    return [(number, fingerprint) for number, fingerprint in found]


def fingerprints(folder: Path) -> list[str]:
    """The pipelines that made the embeddings in a folder's archive."""
    return [fingerprint for _, fingerprint in embeddings(folder)]


def active(folder: Path) -> str:
    """The pipeline that a folder's archive is searched by."""
    ((fingerprint,),) = rows(folder, "SELECT fingerprint FROM archive")
    return str(fingerprint)
