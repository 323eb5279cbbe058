"""What one and what two workers of a cluster do in a second, and what the machine could do at most."""
