"""Sources: folders whose mesh files are shapes and stay where they are.

A folder in; its files found, read where they have changed and stored as shapes; their states out.
"""

__all__ = ["endpoints", "scanner", "schemas", "service"]
