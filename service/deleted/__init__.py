"""Shapes that were deleted, kept for some days so that they can be restored."""
