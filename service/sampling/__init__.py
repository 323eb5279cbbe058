"""The evidence on sampling as tables, pictures and a page."""
