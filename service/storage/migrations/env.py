"""Run by Alembic for each migration, on the connection that `service.storage.migrate` hands over."""

from alembic import context

from service.storage.duplicate_tables import JudgedShapeRow
from service.storage.job_tables import JobRow

# The tables of both modules share the metadata.
assert JudgedShapeRow.metadata is JobRow.metadata
context.configure(connection=context.config.attributes["connection"], target_metadata=JobRow.metadata)
with context.begin_transaction():
    context.run_migrations()
