"""Queries with a part: which stored shapes have what lies about the part's points."""
