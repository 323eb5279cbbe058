"""Two embeddings matched (Eqs. 14-20): embeddings in; CC, SSD, sim and the correspondence out."""

__all__ = ["match_records", "matcher", "procrustes", "quantised_points", "thin_plate_spline"]
