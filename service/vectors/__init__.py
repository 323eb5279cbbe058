"""The nearest signatures, found by the database itself."""
