"""Retrieval of perturbed queries (Fig. 9): scores in; a table, pictures and a page out."""

__all__ = ["figures", "page", "perturbed_queries", "table"]
