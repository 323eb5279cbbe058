"""Run by Alembic for each migration, on the connection that `service.storage.migrate` hands over."""

from alembic import context

from service.storage.tables import Table

context.configure(connection=context.config.attributes["connection"], target_metadata=Table.metadata)
with context.begin_transaction():
    context.run_migrations()
