"""The likeness of chiral and of symmetric parts to their mirror images."""
