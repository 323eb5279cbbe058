"""`isoshape demo` that is asked to stop."""

import os
import signal
import subprocess
import sys

from service.client import Client
from service.server.process import LOOPBACK, bind, wait_until_ready
from tests.service.cli.test_demo import free_port


def test_sigterm_ends_the_service_too() -> None:
    port = free_port()
    command = [sys.executable, "-P", "-m", "service.cli", "demo", "--port", str(port)]
    process = subprocess.Popen(command, env={**os.environ, "ISOSHAPE_LOG_LEVEL": "error"})
    try:
        with Client(f"http://{LOOPBACK}:{port}") as client:
            wait_until_ready(client, ended=lambda: process.poll() is not None)
        process.send_signal(signal.SIGTERM)
        assert process.wait(60) == 128 + signal.SIGTERM
    finally:
        process.kill()
        process.wait()
    bind(LOOPBACK, port).close()
