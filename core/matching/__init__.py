"""Two embeddings matched (Eqs. 14-20): embeddings in; CC, SSD, sim and the correspondence out."""

__all__ = [
    "dense_correspondence",
    "match_records",
    "matcher",
    "matcher_choice",
    "nearest_pairs",
    "procrustes",
]
