"""Logs as lines of JSON, each with the id of its request."""

import json
import logging
from contextvars import ContextVar
from datetime import UTC, datetime

LOGGER = "isoshape"
# Libraries whose errors belong in the log; their other messages are dropped.
LIBRARIES = ("asyncio", "python_multipart", "uvicorn.error")

request_id: ContextVar[str | None] = ContextVar("request_id", default=None)


class JsonFormatter(logging.Formatter):
    """Formats records as JSON: time, level, logger, message, request_id and the `fields` of `extra`."""

    def format(self, record: logging.LogRecord) -> str:
        """Format a record as a line."""
        line: dict[str, object] = {
            "time": datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds"),
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": record.getMessage(),
        }
        identifier = request_id.get()
        if identifier is not None:
            line["request_id"] = identifier
        line.update(getattr(record, "fields", {}))
        if record.exc_info:
            line["traceback"] = self.formatException(record.exc_info)
        return json.dumps(line, default=str)


def get_logger(name: str) -> logging.Logger:
    """Return the logger of a part of the service."""
    return logging.getLogger(f"{LOGGER}.{name}")


def configure(level: str) -> None:
    """Log to standard error as lines of JSON, from severity `level` up; errors of the server too."""
    handler = logging.StreamHandler()
    handler.setFormatter(JsonFormatter())
    for name in (LOGGER, *LIBRARIES):
        logger = logging.getLogger(name)
        logger.setLevel(level.upper() if name == LOGGER else logging.ERROR)
        if not any(isinstance(each.formatter, JsonFormatter) for each in logger.handlers):
            logger.addHandler(handler)
            logger.propagate = name == LOGGER
