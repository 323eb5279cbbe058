"""Which pipeline the archive is searched by, and going over to another."""
