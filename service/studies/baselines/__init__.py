"""Baselines: other methods of shape comparison, by external libraries; meshes in, distances out."""

__all__ = ["methods", "scoring"]
