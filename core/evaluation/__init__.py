"""Evaluation of rankings: scores and class labels in; retrieval measures, classes and calibrations out."""

__all__ = ["calibration", "classification", "retrieval_measures", "score_quantiles"]
