"""Collections: named sets of shapes. Each call works in one."""
