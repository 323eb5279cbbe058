"""Retrieval of perturbed queries as a table, pictures and a page."""
