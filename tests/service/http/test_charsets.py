"""Forms that name a character set: UTF-8 is read, any other is refused before it is decoded."""

import httpx
import pytest

from tests.service.http.responsiveness import assert_others_are_served
from tests.service.support import Running, assert_problem, small_file


def _form(*fields: tuple[bytes, bytes], filename: bytes | None = b"a.off") -> bytes:
    parts = [b'Content-Disposition: form-data; name="' + name + b'"\r\n\r\n' + text for name, text in fields]
    if filename is not None:
        head = b'Content-Disposition: form-data; name="file"; filename="' + filename + b'"\r\n\r\n'
        parts.append(head + small_file(0))
    return b"".join(b"--x\r\n" + part + b"\r\n" for part in parts) + b"--x--\r\n"


def _post(service: Running, path: str, body: bytes, parameters: str) -> httpx.Response:
    headers = {"content-type": f"multipart/form-data; boundary=x{parameters}"}
    return service.client.post(path, content=body, headers=headers)


@pytest.mark.parametrize(
    "charset", ["punycode", "undefined", "utf-7", "utf-16", "latin-1", "idna", "none", ""]
)
@pytest.mark.parametrize("path", ["/shapes", "/query", "/jobs"])
def test_any_other_charset_is_refused(service: Running, path: str, charset: str) -> None:
    answer = _post(service, path, _form((b"name", b"a")), f"; charset={charset}")
    assert_problem(answer, 415, "unsupported-media-type")


@pytest.mark.parametrize(
    "parameters",
    [
        '; charset="punycode"',
        "; CHARSET=punycode",
        "; charset=utf-8; charset=punycode",
        "; charset = punycode",
    ],
)
def test_no_spelling_hides_a_charset(service: Running, parameters: str) -> None:
    """The service finds the same parameter as the parser of the form."""
    answer = _post(service, "/shapes", _form((b"name", "ä".encode())), parameters)
    if answer.status_code == 201:
        assert answer.json()["name"] == "ä"
    else:
        assert_problem(answer, 415, "unsupported-media-type")


@pytest.mark.parametrize("charset", ["utf-8", "UTF-8", '"utf-8"', "utf8"])
def test_a_form_may_say_that_it_is_utf_8(service: Running, charset: str) -> None:
    answer = _post(service, "/shapes", _form((b"name", "Bücher".encode())), f"; charset={charset}")
    assert answer.status_code == 201
    assert answer.json()["name"] == "Bücher"


def test_a_form_in_a_slow_charset_delays_nobody(service: Running) -> None:
    # A name and text that the codec can decode.
    fields = [(b"f%d-" % i, b"b" * 65_000) for i in range(40)]
    body = _form(*fields, filename=None)
    assert_others_are_served(
        service.client, lambda: _post(service, "/query", body, "; charset=punycode"), at_a_time=4
    )


@pytest.mark.parametrize(("fields", "status"), [(40, 413), (3, 201)])
def test_forms_of_much_text_delay_nobody(service: Running, fields: int, status: int) -> None:
    body = _form(*[(b"tags", b"a," * 32_000) for _ in range(fields)])

    def send() -> None:
        answer = _post(service, "/shapes", body, "")
        assert answer.status_code in {status, 200 if status == 201 else status}, answer.text

    assert_others_are_served(service.client, send, at_a_time=2)
