"""Evaluation of the method: scores, labels and truths in; retrieval measures, calibrations and errors out."""

__all__ = ["calibration", "classification", "correspondence_errors", "perturbation", "retrieval_measures"]
