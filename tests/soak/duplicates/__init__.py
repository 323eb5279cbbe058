"""Copies planted in a gallery of several poses of each body, and looked for: `make duplicates-test`."""
