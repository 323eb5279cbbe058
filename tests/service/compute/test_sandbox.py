"""The process that reads uploads: confined, and no loss to anyone when a file ends it."""

import ctypes
import errno
import multiprocessing
import os
import platform
import socket
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import Future
from pathlib import Path
from typing import Any

import landlock
import numpy as np
import pytest
from safetensors.numpy import save

from core.errors import EmptyFileError, MalformedMeshError, MeshTooComplexError
from core.io import DEFAULT_LIMITS, FORMATS, Limits, MeshFile, read_file, read_mesh, read_parts
from service.compute import processes, sandbox
from service.compute.pool import MEMORY_BYTES, LocalPool
from service.compute.request_queue import _log_confinement
from service.compute.sandbox import (
    PartFile,
    largest_size,
    mesh_from_bytes,
    mesh_to_bytes,
    parts_from_bytes,
    parts_to_bytes,
)
from service.compute.worker_loop import JSON_BYTES, decode, encode, encode_error
from service.errors import TaskTimeLimitError, WorkerCrashedError, WorkerLostError
from service.observability.logging import LOGGER
from service.settings import Settings
from tests.core.io.files import PLAIN, glb, off
from tests.core.io.iges_files import iges
from tests.core.io.step_files import step_box, step_machine, step_sphere
from tests.core.io.test_glb import BESIDE, BINARY, zipped
from tests.core.io.test_polygons import PROFILES, prism
from tests.core.io.threemf_files import model, package
from tests.service.compute.attempts import (
    ATTEMPTS,
    MEMORY,
    attempt,
    connect,
    enter,
    hold,
    load,
    open_for,
    resolve,
    send_evil,
    send_half,
    spin,
    start,
)
from tests.service.support import children, small_file, wait_until
from tests.service.tasks import nap, warm


@pytest.fixture(scope="module")
def readers() -> Iterator[LocalPool]:
    with LocalPool(1, seconds=60, warm=enter, answer_bytes=largest_size(DEFAULT_LIMITS)) as pool:
        yield pool


def read(pool: LocalPool, data: bytes, format: str, seconds: float = 30) -> tuple[MeshFile, float]:
    return mesh_from_bytes(pool.submit(sandbox.read_file, data, format, DEFAULT_LIMITS, seconds).result())


FILES: dict[str, Any] = {
    **{format: small_file(0, format) for format in PLAIN},
    **{"3mf": package(), "step": step_sphere(), "iges": iges([[(0, 0, 0), (2, 0, 0), (0, 1, 0), (2, 1, 1)]])},
    "a polygon that is not convex": (off(*prism(PROFILES["channel"])), "off"),
    "a warning": (small_file(0, "stl") + b"more", "stl"),
    "two files in a ZIP": (zipped({"scene.gltf": BESIDE, "a b.bin": BINARY}), "gltf"),
}
# A corner that is none keeps OpenCASCADE busy for ever.
ENDLESS = step_box().replace(b"(0.0,0.0,0.0)", b"(NaN,1E999,0.0)")


@pytest.mark.parametrize("case", FILES)
def test_every_format_is_read_as_anywhere(readers: LocalPool, case: str) -> None:
    data, format = FILES[case] if isinstance(FILES[case], tuple) else (FILES[case], case)
    file, milliseconds = read(readers, data, format)
    here = read_file(data, format)
    assert np.array_equal(file.mesh.vertices, here.mesh.vertices)
    assert np.array_equal(file.mesh.faces, here.mesh.faces)
    assert file.warnings == here.warnings
    assert bool(file.warnings) == (case == "a warning")
    assert milliseconds > 0
    assert set(FILES) >= set(FORMATS)


def test_parts_are_read_as_anywhere(readers: LocalPool) -> None:
    here = read_parts(step_machine(), "step")
    answer = readers.submit(sandbox.read_part_files, step_machine(), "step", DEFAULT_LIMITS, 30).result()
    found = parts_from_bytes(answer, len(here))
    for part, expected in zip(found, here, strict=True):
        assert (part.name, part.path, part.instances) == (expected.name, expected.path, expected.instances)
        assert np.array_equal(read_mesh(part.data, "3mf").vertices, expected.mesh.vertices)
    assert read(readers, small_file(0), "off")[0] is not None
    pair = package(model(items=[(1, "2 0 0 0 2 0 0 0 2 0 0 0"), (1, None)]))
    answer = readers.submit(sandbox.read_part_files, pair, "3mf", DEFAULT_LIMITS, 30).result()
    assert len(parts_from_bytes(answer, 2)) == 2
    alone = readers.submit(sandbox.read_part_files, step_box(), "step", DEFAULT_LIMITS, 30).result()
    assert parts_from_bytes(alone, 0) == []


MODES = ("w", "a", "x", "r+")


@pytest.mark.parametrize("name", ATTEMPTS)
def test_the_kernel_refuses_native_code(readers: LocalPool, tmp_path: Path, name: str) -> None:
    """On a kernel with Landlock and seccomp, as that of every Linux from 5.13 may be."""
    (tmp_path / "kept").touch()
    assert readers.submit(sandbox.confinement).result() == {"landlock": True, "seccomp": True}
    result, number = readers.submit(attempt, name, str(tmp_path)).result()
    assert result == -1
    assert number in {errno.EPERM, errno.EACCES}
    assert [path.name for path in tmp_path.iterdir()] == ["kept"]


def test_a_log_line_says_what_confines_readers(caplog: pytest.LogCaptureFixture) -> None:
    for found in (
        {"landlock": True, "seccomp": True},
        {"landlock": False, "seccomp": False},
        {"landlock": False, "seccomp": True},
        WorkerLostError("no worker process could be started"),
    ):
        answer: Future[dict[str, bool]] = Future()
        (answer.set_exception if isinstance(found, Exception) else answer.set_result)(found)
        with caplog.at_level("INFO", logger=LOGGER):
            _log_confinement(answer)
    both, neither, one, unknown = (record.getMessage() for record in caplog.records)
    assert both == "readers of uploads are confined by Landlock and seccomp"
    assert "not confine readers of uploads by landlock and seccomp" in neither
    assert "not confine readers of uploads by landlock:" in one
    assert "unknown whether this system confines readers" in unknown
    assert "could be started" in unknown


@pytest.mark.parametrize("release", ["5.15.133+", "", "5.10.0-28-amd64", "6.18.44"])
def test_no_version_of_a_kernel_keeps_readers_from_starting(
    monkeypatch: pytest.MonkeyPatch, release: str
) -> None:
    """The package asks for the version where the kernel refuses its system call."""
    monkeypatch.setattr(platform, "release", lambda: release)

    def refused() -> None:
        ctypes.set_errno(errno.ENOSYS)
        landlock.plumbing.syscall_errcheck(-1, refused, ())

    monkeypatch.setattr(landlock, "Ruleset", refused)
    assert not sandbox.forbid_files()


def _filtered(name: str) -> None:
    sandbox.ALLOWED = (*sandbox.ALLOWED, name)
    sys.exit(0 if sandbox.allow_calls(opening=False) else 3)


def test_an_unknown_system_call_does_not_end_the_filter() -> None:
    process = multiprocessing.get_context("fork").Process(
        target=_filtered, args=("no_such_call",), daemon=True
    )
    process.start()
    process.join(60)
    assert process.exitcode == 0


def test_without_the_packages_readers_are_confined_by_python_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sandbox, "landlock", None)
    monkeypatch.setattr(sandbox, "seccomp", None)
    assert not sandbox.forbid_files()
    assert not sandbox.allow_calls(opening=True)


def test_nothing_that_a_reader_sends_is_unpickled(readers: LocalPool, tmp_path: Path) -> None:
    with pytest.raises(WorkerLostError):
        readers.submit(send_evil, str(tmp_path / "made")).result()
    assert not (tmp_path / "made").exists()
    assert read(readers, small_file(0), "off")[0] is not None


def test_half_an_answer_has_the_time_limit_of_the_call() -> None:
    with LocalPool(1, seconds=5, warm=load, answer_bytes=1000) as pool:
        with pytest.raises(TaskTimeLimitError, match="answer"):
            pool.submit(send_half).result(timeout=60)
        assert pool.submit(nap, 0).result(timeout=60) is None


def test_an_answer_has_a_largest_size(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(processes, "END_SECONDS", 0.2)
    with LocalPool(1, seconds=60, warm=warm, answer_bytes=1000) as pool:
        assert pool.submit(bytes, 999).result(timeout=60) == bytes(999)
        with pytest.raises(WorkerCrashedError):
            pool.submit(bytes, 1000).result(timeout=60)
    for format in ("off", "stl"):
        whole = read_file(small_file(0, format), format)
        assert len(mesh_to_bytes(whole, 1.0)) < largest_size(Limits(122, 240, 1))
    # An STL of a million faces has three million vertices before they are merged.
    assert largest_size(Limits(500_000, 1_000_000, 1)) > 24 * 4_000_000


def test_the_text_of_an_error_is_cut() -> None:
    with pytest.raises(EmptyFileError) as caught:
        decode(encode_error(EmptyFileError("\0" * 10**6), "ж" * 10**6))
    assert 1000 < len(str(caught.value)) < JSON_BYTES


@pytest.mark.parametrize(
    "answer",
    [b"V" + b'"' + b"x" * JSON_BYTES + b'"', b"", b"X1", b"V{", b"E[1]", b"E{}", b"V" + b"[" * 100_000],
)
def test_an_answer_of_another_form_is_no_answer(answer: bytes) -> None:
    with pytest.raises(WorkerCrashedError):
        decode(answer)


def test_answers_come_back_as_they_were() -> None:
    for result in (b"", b"\0bytes", None, 7, "text", {"a": [1.5, True]}):
        assert decode(encode(result)) == result
    with pytest.raises(EmptyFileError, match="nothing") as caught:
        decode(encode_error(EmptyFileError("nothing"), "a note"))
    assert caught.value.__notes__ == ["a note"]
    with pytest.raises(RuntimeError, match="SystemExit: 3"):
        decode(b'E["SystemExit", "3", ""]')


@pytest.mark.parametrize(
    "arrays",
    [
        {},
        {"vertices": np.eye(3), "faces": np.array([[0, 1, 9]]), "milliseconds": np.ones(1)},
        {"vertices": np.eye(3) * np.nan, "faces": np.array([[0, 1, 2]]), "milliseconds": np.ones(1)},
        {"vertices": np.ones(3), "faces": np.array([[0, 1, 2]]), "milliseconds": np.ones(1)},
        {"vertices": np.eye(3, dtype=np.float32), "faces": np.array([[0, 1, 2]]), "milliseconds": np.ones(1)},
        {"vertices": np.eye(3), "faces": np.array([[0, 1, 2]]), "milliseconds": np.ones(2)},
    ],
)
def test_a_mesh_from_a_reader_is_checked(arrays: dict[str, np.ndarray]) -> None:
    with pytest.raises(MalformedMeshError):
        mesh_from_bytes(save(arrays))
    with pytest.raises(MalformedMeshError):
        mesh_from_bytes(b"no safetensors")


@pytest.mark.parametrize(
    "about",
    [
        b"{",
        b"7",
        b"[7]",
        b"[" * 100_000,
        b'[["a", ["b"], 0]]',
        b'[["a", ["b"], 1.5]]',
        b'[["a", ["b"], true]]',
        b'[[7, ["b"], 1]]',
        b'[["a\\n", ["b"], 1]]',
        b'[["a", ["\\ud800"], 1]]',
        b'[["a", [["b"]], 1]]',
        b'[["a", 7, 1]]',
        b'[["a", ["b"], 1], ["c", ["d"], 1]]',
        b'[["' + b"x" * 300 + b'", ["b"], 1]]',
        b'[["a", [' + b", ".join([b'"b"'] * 65) + b"], 1]]",
    ],
)
def test_parts_from_a_reader_are_checked(about: bytes) -> None:
    arrays = {"0": np.zeros(3, np.uint8), "about": np.frombuffer(about, np.uint8)}
    with pytest.raises(MalformedMeshError):
        parts_from_bytes(save(arrays), 9)


def test_parts_from_a_reader_are_limited() -> None:
    parts = [PartFile("a", ("b", "a"), 2, b"3mf"), PartFile("", (), 1, b"")]
    assert parts_from_bytes(parts_to_bytes(parts), 2) == parts
    with pytest.raises(MalformedMeshError):
        parts_from_bytes(parts_to_bytes(parts), 1)
    with pytest.raises(MalformedMeshError):
        parts_from_bytes(b"no safetensors", 2)


@pytest.mark.parametrize(
    "path", ["/etc/passwd", "/etc/../etc/passwd", f"{sys.prefix}/../../../../../etc/passwd"]
)
def test_no_file_of_the_machine_is_opened(readers: LocalPool, path: str) -> None:
    with pytest.raises(PermissionError, match="may not open"):
        readers.submit(open_for, path, "rb").result()


def test_nothing_is_written_removed_started_or_asked_of_the_network(
    readers: LocalPool, tmp_path: Path
) -> None:
    (tmp_path / "kept").touch()
    beside = Path(sandbox.__file__).with_name("new.txt")
    with socket.create_server(("127.0.0.1", 0)) as listening:
        for call, arguments, said in (
            *(
                (open_for, (str(path), mode), "may not open")
                for path in (tmp_path / "new", beside)
                for mode in MODES
            ),
            (os.remove, (str(tmp_path / "kept"),), r"os\.remove"),
            (os.unlink, (str(tmp_path / "kept"),), r"os\.remove"),
            (os.mkdir, (str(tmp_path / "made"),), r"os\.mkdir"),
            (resolve, ("localhost",), "may do no|Permission denied"),
            (connect, (listening.getsockname()[1],), "may do no|Permission denied"),
            (start, ("true",), "may do no|Permission denied"),
            (os.system, ("true",), "may do no|Permission denied"),
        ):
            with pytest.raises(PermissionError, match=said):
                readers.submit(call, *arguments).result()
    assert [path.name for path in tmp_path.iterdir()] == ["kept"]
    assert not beside.exists()


def test_a_file_that_takes_more_memory_than_there_is_is_refused(readers: LocalPool) -> None:
    with pytest.raises(MemoryError):
        readers.submit(bytes, MEMORY).result()
    pids = readers.pids()
    with pytest.raises(MeshTooComplexError, match="memory"):
        read(readers, many_instances(), "glb")
    assert read(readers, small_file(0), "off")[0] is not None
    assert readers.pids() == pids


def many_instances() -> bytes:
    """A quarter of a megabyte that stands for 3.9 million faces: half a gigabyte to read."""
    side, times = 100, 200
    x, y = np.meshgrid(np.arange(side), np.arange(side), indexing="ij")
    corner = (np.arange(side - 1)[:, None] * side + np.arange(side - 1)).ravel()
    lower = np.column_stack([corner, corner + side, corner + side + 1])
    upper = np.column_stack([corner, corner + side + 1, corner + 1])
    sheet = np.column_stack([x.ravel(), y.ravel(), np.sin(x * y).ravel()])
    nodes = [{"mesh": 0, "translation": [side * i, 0, 0]} for i in range(times)]
    scenes = [{"nodes": list(range(times))}]
    return glb(sheet, np.vstack([lower, upper]), nodes=nodes, scenes=scenes)


def test_processor_time_is_counted_file_by_file(readers: LocalPool) -> None:
    wait_until(readers.pids, seconds=60)
    pids = readers.pids()
    for _ in range(3):
        readers.submit(spin, 0.7).result()
        read(readers, small_file(0), "off", 1)
    assert readers.pids() == pids
    with pytest.raises(TaskTimeLimitError, match="processor time"):
        readers.submit(spin, 600).result()
    assert read(readers, small_file(0), "off")[0] is not None
    assert readers.pids() != pids


def test_a_task_that_never_ends_is_ended(readers: LocalPool) -> None:
    with pytest.raises(TaskTimeLimitError, match="processor time"):
        read(readers, ENDLESS, "step", 1)
    assert read(readers, step_box(), "step")[0] is not None


def test_a_process_is_replaced_after_so_many_tasks() -> None:
    with LocalPool(1, seconds=60, warm=warm, tasks_each=3) as pool:
        pids = [pool.submit(os.getpid).result() for _ in range(9)]
        assert [len(set(pids[i : i + 3])) for i in (0, 3, 6)] == [1, 1, 1]
        assert len(set(pids)) == 3
        # A task that fails counts as well.
        with pytest.raises(TypeError):
            pool.submit(nap, "long").result()
        assert {pool.submit(os.getpid).result() for _ in range(3)} & set(pids) == set()


def test_the_next_process_is_started_before_it_is_needed() -> None:
    others = children()
    with LocalPool(1, seconds=60, warm=warm, tasks_each=20) as pool:
        first = pool.submit(os.getpid).result()
        assert {pool.submit(os.getpid).result() for _ in range(17)} == {first}
        wait_until(lambda: len(children() - others) == 2, seconds=60)
        assert pool.pids() == [first]
        (following,) = children() - others - {first}
        assert [pool.submit(os.getpid).result() for _ in range(3)] == [first, first, following]
    assert children() == others


def test_a_pool_that_closes_leaves_no_process_that_was_on_its_way() -> None:
    others = children()
    with LocalPool(1, seconds=60, warm=warm, tasks_each=2) as pool:
        pool.submit(os.getpid).result()
    assert children() == others


def test_a_process_that_holds_on_to_memory_is_replaced() -> None:
    with LocalPool(1, seconds=60, warm=warm) as pool:
        first = pool.submit(os.getpid).result()
        pool.submit(hold, MEMORY_BYTES // 8).result()
        assert pool.submit(os.getpid).result() == first
        pool.submit(hold, MEMORY_BYTES).result()
        assert pool.submit(os.getpid).result() != first


def test_a_reader_of_step_says_nothing_and_writes_nothing_before_or_after(tmp_path: Path) -> None:
    """OpenCASCADE prints what it could not read, and passes the rest on through files in memory.

    The limit of the system, below Python's, is on a file that was open before the process was confined.
    """
    script = (
        "import sys, os; from core.errors import MeshError; from core.io import DEFAULT_LIMITS\n"
        "from service.compute import sandbox; from tests.core.io.step_files import step_box\n"
        "descriptor = os.open(sys.argv[1], os.O_CREAT | os.O_WRONLY)\n"
        "def write():\n"
        "    try: os.write(descriptor, b'x')\n"
        "    except OSError as error: print(error.errno, flush=True)\n"
        f"sandbox.enter({MEMORY})\n"
        "write()\n"
        "assert sandbox.read_file(step_box(), 'step', DEFAULT_LIMITS, 30)\n"
        "try: sandbox.read_file(step_box()[:2000], 'step', DEFAULT_LIMITS, 30)\n"
        "except MeshError: print('refused', flush=True)\n"
        "write()\n"
    )
    command = [sys.executable, "-c", script, str(tmp_path / "open")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
        said, _ = process.communicate()
    assert said.split() == [str(errno.EFBIG), "refused", str(errno.EFBIG)]
    assert (tmp_path / "open").read_bytes() == b""


def test_the_default_memory_is_enough_for_the_default_limits() -> None:
    settings = Settings.model_construct()
    assert settings.read_memory_bytes > 20 * settings.max_upload_bytes
