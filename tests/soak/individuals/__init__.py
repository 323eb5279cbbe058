"""Similar individuals in several poses, made by code, as a collection to evaluate."""
