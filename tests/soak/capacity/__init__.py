"""What a shape takes, and what a search of ten million signatures takes, for docs/capacity.md."""
