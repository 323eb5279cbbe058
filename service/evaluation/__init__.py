"""Evaluation on collections and benchmarks: labelled meshes in; scores of all pairs, errors and times out."""

__all__ = [
    "baselines",
    "benchmark_method",
    "benchmark_service",
    "benchmark_shapes",
    "calibration",
    "pairwise_scores",
    "retrieval",
    "template_truth",
]
