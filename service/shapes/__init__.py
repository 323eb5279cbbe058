"""Shapes: stored, listed, read, changed, deleted."""
