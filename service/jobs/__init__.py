"""Bulk jobs: an archive of meshes is stored whole, and its members are then taken up one by one."""
