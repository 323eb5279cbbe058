"""A query and what it found, as one page that needs nothing else."""
