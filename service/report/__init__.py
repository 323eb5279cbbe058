"""The report of a query: an answer in, one self-contained HTML page out."""

__all__ = ["pictures", "report"]
