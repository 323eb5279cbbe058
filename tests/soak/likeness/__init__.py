"""The likeness of pairs made by code."""
