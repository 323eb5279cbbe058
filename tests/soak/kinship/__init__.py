"""Kinship of parts made by code with their copies and variants, by a running service: `make kinship-test`."""
