"""Readiness while the service starts: the answer says what the service is doing."""

from pathlib import Path

import pytest

from core.io import write_mesh
from service import app
from service.compute.pool import LocalPool
from service.system import endpoints
from tests.core.shapes import icosphere
from tests.service.support import assert_problem, serving, settings_in


@pytest.mark.parametrize(("compiled", "told"), [(False, "kernels are compiled"), (True, "no worker process")])
def test_readyz_tells_of_the_compilation(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, compiled: bool, told: str
) -> None:
    with monkeypatch.context() as patch, serving(settings_in(tmp_path), ready=False) as running:
        patch.setattr(LocalPool, "ready", lambda pool: False)
        patch.setattr(endpoints, "is_compiled", lambda parameters: compiled)
        problem = assert_problem(running.client.get("/readyz"), 503, "not-ready")
        assert told in problem["detail"]
        # The page is sent meanwhile, with the place where it says so.
        assert 'id="starting"' in running.client.get("/").text


def test_uploads_and_queries_are_refused_while_no_worker_can_start(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch, serving(settings_in(tmp_path)) as running:
        patch.setattr(LocalPool, "pids", lambda pool: [])
        patch.setattr(app, "is_compiled", lambda parameters: False)
        file = {"file": ("ball.off", write_mesh(icosphere(2), "off"))}
        for address in ("/shapes", "/query"):
            answer = running.client.post(address, files=file)
            assert "kernels are compiled" in assert_problem(answer, 503, "busy")["detail"]
            assert int(answer.headers["Retry-After"]) > 0
        patch.setattr(app, "is_compiled", lambda parameters: True)
        assert running.client.post("/shapes", files=file).status_code == 201
