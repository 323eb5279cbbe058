"""The steps that bring a database from one version of the service to the next (Alembic)."""
