"""Evaluation on collections and benchmarks: labelled meshes in; scores of all pairs, errors and times out."""

__all__ = [
    "archive_repository",
    "baselines",
    "benchmark_meshes",
    "benchmark_method",
    "benchmark_service",
    "calibration",
    "pairwise_scores",
    "retrieval",
    "template_truth",
]
