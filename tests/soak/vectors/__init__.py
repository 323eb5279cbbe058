"""How long PostgreSQL takes to find the nearest of many signatures, and how many of them its graph misses."""
