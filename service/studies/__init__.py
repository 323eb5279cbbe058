"""Studies of the method: labelled collections in, scores of all pairs and tables out."""

__all__ = ["functional_maps", "pairwise_scores", "retrieval", "subset", "truth"]
