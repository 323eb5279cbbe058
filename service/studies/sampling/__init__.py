"""The evidence on sampling (Figs. 2 and 3): trials in; tables, pictures and a page out."""

__all__ = ["figures", "page", "tables"]
