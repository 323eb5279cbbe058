"""Settings: read, refused, and documented."""

import re
import traceback
from pathlib import Path
from urllib.parse import urlsplit

import pytest
import yaml
from sqlalchemy import make_url

from core.parameters import DEFAULT, PAPER
from service.jobs.runner import ARRIVING
from service.settings import OTHER_VARIABLES, PREFIX, Settings, SettingsError, load_parameters, load_settings
from service.storage.postgresql import CONNECTIONS, MORE_CONNECTIONS

ROOT = Path(__file__).parents[2]
DOCUMENT = ROOT / "docs" / "settings.md"
COMPOSE = ROOT / "docker" / "compose.yaml"
CLUSTER = ROOT / "docker" / "compose.cluster.yaml"


@pytest.fixture(autouse=True)
def no_settings(monkeypatch: pytest.MonkeyPatch) -> None:
    """None of the environment's own."""
    for name in (PREFIX + field.upper() for field in Settings.model_fields):
        monkeypatch.delenv(name, raising=False)


def test_the_document_has_each_setting_with_its_default_and_meaning() -> None:
    rows = re.findall(r"(?m)^\| `(\w+)` \| (.*?) \| (.+) \|$", DOCUMENT.read_text(encoding="utf-8"))
    assert [name for name, _, _ in rows] == [PREFIX + name.upper() for name in Settings.model_fields]
    for (name, shown, meaning), field in zip(rows, Settings.model_fields.values(), strict=True):
        default = "one per processor" if field.default_factory else field.default
        default = str(default).lower() if isinstance(default, bool) else default
        default = f"{default:g}" if isinstance(default, float) else str(default or "")
        assert shown == (f"`{default}`" if default else ""), name
        assert meaning.endswith("."), name


def test_the_document_names_no_variable_that_is_not_known() -> None:
    named = set(re.findall(r"ISOSHAPE_[A-Z_]+[A-Z]", DOCUMENT.read_text()))
    assert named == {PREFIX + name.upper() for name in Settings.model_fields} | OTHER_VARIABLES


def test_defaults(monkeypatch: pytest.MonkeyPatch) -> None:
    settings = load_settings()
    assert settings.database_url == "sqlite:///isoshape-data/isoshape.sqlite3"
    assert settings.workers >= 1
    assert load_parameters(settings.pipeline) == DEFAULT
    assert load_parameters("paper") == PAPER


def test_variables_are_read(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ISOSHAPE_WORKERS", "3")
    monkeypatch.setenv("isoshape_port", "0")
    settings = load_settings()
    assert (settings.workers, settings.port) == (3, 0)


@pytest.mark.parametrize(
    "url",
    [
        "sqlite:///file.sqlite3",
        "sqlite+pysqlite:////srv/file.sqlite3",
        "postgresql://localhost/isoshape",
        "postgresql+psycopg://user:word@host:5433/isoshape?sslmode=require",
    ],
)
def test_either_engine_is_taken(monkeypatch: pytest.MonkeyPatch, url: str) -> None:
    monkeypatch.setenv("ISOSHAPE_DATABASE_URL", url)
    assert load_settings().database_url == url


def test_digests_are_separated_by_commas(monkeypatch: pytest.MonkeyPatch) -> None:
    assert not load_settings().has_keys
    monkeypatch.setenv("ISOSHAPE_API_KEYS", "")
    assert not load_settings().has_keys
    monkeypatch.setenv("ISOSHAPE_API_KEYS", f" {'A' * 64} ,{'b' * 64},")
    assert load_settings().api_keys == ("a" * 64, "b" * 64)
    assert load_settings().has_keys
    monkeypatch.setenv("ISOSHAPE_API_KEYS", f"{'A' * 64}:castings+test-2, {'b' * 64}")
    assert load_settings().api_keys == (f"{'a' * 64}:castings+test-2", "b" * 64)
    monkeypatch.delenv("ISOSHAPE_API_KEYS")
    monkeypatch.setenv("ISOSHAPE_READ_KEYS", "0" * 64)
    assert load_settings().has_keys


def test_a_key_in_the_place_of_its_digest_is_not_repeated(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ISOSHAPE_API_KEYS", "isoshape_secret")
    with pytest.raises(SettingsError, match="64 hexadecimal digits") as refused:
        load_settings()
    assert "isoshape_secret" not in "".join(traceback.format_exception(refused.value))


def test_variables_of_other_parts_are_let_be(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in OTHER_VARIABLES:
        monkeypatch.setenv(name, "x")
    load_settings()


def test_unknown_variables_are_refused_by_name(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ISOSHAPE_WORKER", "3")
    monkeypatch.setenv("ISOSHAPE_DATABASE", "x")
    with pytest.raises(
        SettingsError,
        match=r"unknown settings: ISOSHAPE_DATABASE \(did you mean ISOSHAPE_DATABASE_URL\?\), "
        r"ISOSHAPE_WORKER \(did you mean ISOSHAPE_WORKERS\?\); docs/settings.md",
    ) as refused:
        load_settings()
    assert "ISOSHAPE_LOG_LEVEL" not in str(refused.value)

    for name in ("ISOSHAPE_WORKER", "ISOSHAPE_DATABASE"):
        monkeypatch.delenv(name)
    monkeypatch.setenv("ISOSHAPE_QQQQ", "3")
    with pytest.raises(SettingsError, match=r"^unknown settings: ISOSHAPE_QQQQ; docs/settings.md"):
        load_settings()


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("WORKERS", "0"),
        ("WORKERS", "many"),
        ("PORT", "70000"),
        ("TASK_SECONDS", "inf"),
        ("TASK_SECONDS", "nan"),
        ("LOCK_SECONDS", "-1"),
        ("LOG_LEVEL", "loud"),
        ("MAX_UPLOAD_BYTES", "-5"),
        ("RATE_LIMIT", "-1"),
        ("API_KEYS", "isoshape_a-key-itself"),
        ("API_KEYS", "0" * 63),
        ("READ_KEYS", "0" * 64 + "," + "g" * 64),
        ("SIGNATURES", "database"),
        ("SIGNATURES", "disk"),
        ("SCHEDULER", "localhost:8786"),
        ("SCHEDULER", "tcp://localhost"),
        ("SCHEDULER", "http://localhost:8786"),
        ("WEBHOOK_SECRET", "whsec_c2hvcnQ="),
        ("WEBHOOK_SECRET", "no base64, but long enough for one"),
        ("WEBHOOK_URL", "https://without.secret/"),
        ("WEBHOOK_URL", "ftp://host/"),
        ("WEBHOOK_URL", "https:///path"),
        ("DATABASE_URL", "archive.sqlite3"),
        ("DATABASE_URL", "sqlite://"),
        ("DATABASE_URL", "sqlite:///:memory:"),
        ("DATABASE_URL", "mysql://localhost/isoshape"),
        ("DATABASE_URL", "postgresql://localhost"),
        ("DATABASE_URL", "postgresql+psycopg2://localhost/isoshape"),
    ],
)
def test_a_value_out_of_range_is_refused_by_name(
    monkeypatch: pytest.MonkeyPatch, name: str, value: str
) -> None:
    monkeypatch.setenv(PREFIX + name, value)
    with pytest.raises(SettingsError, match=f"^{PREFIX}{name}: "):
        load_settings()


def test_parameters_come_from_a_file_and_without_a_name_are_called_as_it(tmp_path: Path) -> None:
    path = tmp_path / "few samples.json"
    path.write_text(DEFAULT.model_dump_json())
    assert load_parameters(str(path)) == DEFAULT
    path.write_text('{"sampling": {"samples": 60}}')
    parameters = load_parameters(str(path))
    assert (parameters.name, parameters.sampling.samples) == ("few samples", 60)
    path.write_text('{"sampling": {"samples": 60}, "name": "sixty"}')
    assert load_parameters(str(path)).name == "sixty"
    assert load_parameters(str(path)).fingerprint == parameters.fingerprint


@pytest.mark.parametrize(
    "content", [b"{", b"[]", b'{"sampling": {"samples": "many"}}', b'{"no such parameter": 1}', b"\xff\xfe"]
)
def test_a_file_that_holds_no_parameters_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "parameters.json"
    path.write_bytes(content)
    with pytest.raises(SettingsError, match=r"ISOSHAPE_PIPELINE.*parameters\.json"):
        load_parameters(str(path))


def test_a_pipeline_that_is_no_file_is_refused(tmp_path: Path) -> None:
    for pipeline in ("fast", str(tmp_path / "missing.json"), str(tmp_path)):
        with pytest.raises(SettingsError, match="neither default nor paper nor a file"):
            load_parameters(pipeline)


def test_uploads_in_the_container_fit_its_temporary_folder(monkeypatch: pytest.MonkeyPatch) -> None:
    service = yaml.safe_load(COMPOSE.read_text())["services"]["isoshape"]
    values = {name: str(value) for name, value in service["environment"].items()}
    # A key must be given, and a read-only one may.
    assert values["ISOSHAPE_API_KEYS"].startswith("${ISOSHAPE_API_KEYS:?")
    assert values["ISOSHAPE_READ_KEYS"] == "${ISOSHAPE_READ_KEYS:-}"
    for name, value in values.items():
        if "$" in value:
            continue
        monkeypatch.setenv(name, value)
    settings = load_settings()
    (room,) = re.findall(r"^/tmp:size=(\d+)m,", service["tmpfs"][0])
    (memory,) = re.findall(r"^(\d+)g$", service["mem_limit"])
    inside = settings.workers + settings.queue_length
    largest = settings.max_upload_bytes / 2**20
    archive = settings.max_archive_bytes / 2**20
    assert inside * largest + ARRIVING * archive <= int(room)
    # The share of a client that sends uploads alone; each has some overhead.
    assert inside * (largest + 1) + 2 * (archive + 1) <= int(room)
    # Those at work, with one for another client; as many files of jobs; what a worker is sent, and needs.
    at_work = settings.workers + 1
    assert int(room) + (1 + 1 + 1 + 20) * at_work * largest + 1100 <= 1024 * int(memory)


def test_the_compose_file_of_a_cluster_fits_together(monkeypatch: pytest.MonkeyPatch) -> None:
    services = yaml.safe_load(CLUSTER.read_text())["services"]
    for name, value in services["isoshape"]["environment"].items():
        if name.startswith(PREFIX) and "$" not in str(value):
            monkeypatch.setenv(name, str(value))
    settings = load_settings()
    database, scheduler = make_url(settings.database_url), urlsplit(settings.scheduler)
    assert (database.host, database.username, database.database) == (
        "postgres",
        services["postgres"]["environment"]["POSTGRES_USER"],
        services["postgres"]["environment"]["POSTGRES_DB"],
    )
    assert scheduler.hostname == "scheduler"
    command = services["scheduler"]["command"]
    assert command[command.index("--port") + 1] == str(scheduler.port)
    assert settings.scheduler in services["worker"]["command"]
    (most,) = re.findall(r"max_connections=(\d+)", " ".join(services["postgres"]["command"]))
    connections = CONNECTIONS + MORE_CONNECTIONS
    assert services["isoshape"]["deploy"]["replicas"] * connections < int(most) / 2
    # The proxy lets through what the service takes, and a little around it.
    (through,) = re.findall(r"client_max_body_size (\d+)m;", (CLUSTER.parent / "nginx.conf").read_text())
    assert int(through) * 2**20 > settings.max_archive_bytes
    for name in ("isoshape", "worker", "scheduler", "proxy"):
        assert services[name]["read_only"]
        assert services[name]["cap_drop"] == ["ALL"]
    assert "ports" not in {key for name in services if name != "proxy" for key in services[name]}
