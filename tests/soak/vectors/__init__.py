"""The time that PostgreSQL takes to find the nearest of many signatures, and the recall of its graph."""
