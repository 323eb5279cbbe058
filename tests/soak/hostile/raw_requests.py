"""Hostile requests, as bytes: forms, headers and bodies that stop, whatever their file."""

from collections.abc import Iterator
from typing import NamedTuple

from tests.service.support import small_file

HOST = b"Host: localhost"
MB = 1_000_000


class Hostile(NamedTuple):
    """A request: all that is sent on a connection that stays open, and the statuses that it may get."""

    name: str
    sent: bytes
    statuses: frozenset[int]


def head(method: str, path: str, *lines: bytes) -> bytes:
    return f"{method} {path} HTTP/1.1\r\n".encode() + b"".join(line + b"\r\n" for line in lines) + b"\r\n"


def part(name: bytes, content: bytes, *, filename: bytes | None = None, more: bytes = b"") -> bytes:
    """Return a part of a form."""
    named = b"" if filename is None else b'; filename="%b"' % filename
    disposition = b'Content-Disposition: form-data; name="%b"' % name
    return b"--b\r\n" + disposition + named + more + b"\r\n\r\n" + content + b"\r\n"


def form(path: str, *parts: bytes, parameters: bytes = b"; boundary=b") -> bytes:
    """Return a request with a form."""
    return posted(path, b"".join(parts) + b"--b--\r\n", b"multipart/form-data" + parameters)


def posted(path: str, body: bytes, kind: bytes = b"application/json", length: int | None = None) -> bytes:
    """Return a request with a body, which may have another length than it says."""
    declared = b"Content-Length: %d" % (len(body) if length is None else length)
    return head("POST", path, HOST, b"Content-Type: " + kind, declared) + body


FILE = part(b"file", small_file(1), filename=b"a.off")
REFUSED = frozenset({400, 413, 415, 422})
TAKEN = REFUSED | {200, 201}
NAMED = frozenset({200, 400, 404, 422})
RANGE = frozenset({200, 206, 416})
CHUNKED = b"Transfer-Encoding: chunked"
CHARSETS = (
    *("punycode", "undefined", "idna", "utf-7", "utf-16", "utf-32", "unicode_escape", "raw_unicode_escape"),
    *("zlib", "bz2", "base64", "rot13", "uu", "quopri", "hex", "mbcs", "oem", "x" * 9000),
)
BROKEN = {
    "part charset": part(b"name", b"b" * 60_000, more=b"\r\nContent-Type: text/plain; charset=punycode"),
    "_charset_": part(b"_charset_", b"punycode") + part(b"name", b"bbb-"),
    "transfer encoding": part(b"name", b"eA==", more=b"\r\nContent-Transfer-Encoding: base64"),
    "content encoding": part(b"name", b"x", more=b"\r\nContent-Encoding: gzip"),
    "nested form": part(b"name", FILE, more=b"\r\nContent-Type: multipart/mixed; boundary=b"),
    "no UTF-8": part(b"name", b"\xff\xfe\xed\xa0\x80"),
    "NUL": part(b"name", b"\0" * 100),
    "surrogates in JSON": part(b"metadata", b'{"a": "\\ud800", "\\udfff": 1}'),
    "deep JSON": part(b"metadata", b"[" * 60_000),
    "long number": part(b"metadata", b'{"a": ' + b"9" * 60_000 + b"}"),
    "infinite number": part(b"metadata", b'{"a": 1e999, "b": NaN}'),
    "name as filename*": part(b"file", b"x", more=b"; filename*=utf-8''%ff%00a.off"),
    "header without end": b"--b\r\nX: " + b"y" * 70_000,
    "many headers": b"--b\r\n" + b"".join(b"X%d: y\r\n" % i for i in range(5000)) + b"\r\n\r\n",
    "two files": FILE + FILE,
    "empty names": part(b"", b"") + part(b"", b"x", filename=b""),
}
BOUNDARIES = (b"", b"; boundary=", b'; boundary="', b"; boundary=" + b"b" * 9000, b"; boundary=\xff")
REBOUND = b"rebound.example"
ODD_LINES = (
    b"X-API-Key: \xff\xfe",
    b"Authorization: Bearer \xed\xa0\x80",
    b"Cookie: isoshape_session=\xff; ;;=;",
    b"Isoshape-Collection: \xff",
    b"Accept: " + b"a/b," * 9000,
    b"X-Request-ID: \xff",
    b"Expect: 100-continue",
    b"Idempotency-Key: \xff",
    b'If-Match: "\xff',
    b"Upgrade: websocket\r\nConnection: upgrade",
)
ODD_PATHS = (
    *("/shapes?name=%ed%a0%80", "/shapes?cursor=%ff", "/shapes/%00", "/shapes?tag=%ud800"),
    *("/shapes/../healthz", "/shapes?" + "a=1&" * 3000, "//shapes", "/shapes?limit=" + "9" * 5000),
)
ODD_BODIES = (b'{"first": "\\ud800", "second": "\\udfff"}', b"[" * 100_000, b"\xff\xfe", b'"x"', b"9" * 5000)


def forms(_shape: str) -> Iterator[Hostile]:
    """Yield forms: charsets, many fields, nested and broken encodings."""
    long = part(b"name-", b"b" * 60_000)
    many = [part(b"tags", b"t%d" % i) for i in range(640)]
    text = [part(b"tags", b"a," * 30_000)] * 20
    for path in ("/shapes", "/query", "/jobs", "/preview"):
        for charset in CHARSETS:
            sent = form(path, long, FILE, parameters=f"; boundary=b; charset={charset}".encode())
            yield Hostile(f"{path} charset {charset[:20]}", sent, frozenset({415}))
        yield Hostile(f"{path} 640 fields", form(path, *many, FILE), TAKEN)
        yield Hostile(f"{path} 641 fields", form(path, *many, part(b"x", b""), FILE), frozenset({400}))
        yield Hostile(f"{path} much text", form(path, *text, FILE), frozenset({413}))
        for name, content in BROKEN.items():
            yield Hostile(f"{path} {name}", form(path, content, FILE), TAKEN)
        for parameters in BOUNDARIES:
            sent = form(path, FILE, parameters=parameters)
            yield Hostile(f"{path} boundary {parameters[:20]!r}", sent, TAKEN)


def headers(_shape: str) -> Iterator[Hostile]:
    """Yield headers, paths and JSON that no client sends."""
    misdirected, refused_or_late = frozenset({400, 421}), REFUSED | {408}
    for origin in (b"http://[", b"http://]", b"//[", b"\xff", b"null", b"a" * 60_000, b"http://[::1"):
        sent = head("POST", "/shapes", HOST, b"Origin: " + origin)
        yield Hostile(f"Origin {origin[:9]!r}", sent, frozenset({400, 403}))
    for host in (b"", b"[", REBOUND, b"localhost." + REBOUND, b"\xff", b"@localhost", b"a" * 60_000):
        yield Hostile(f"Host {host[:9]!r}", head("GET", "/shapes", b"Host: " + host), misdirected)
    yield Hostile("no Host", head("GET", "/shapes"), misdirected)
    yield Hostile("two Hosts", head("GET", "/shapes", HOST, b"Host: " + REBOUND), misdirected)
    for asked in (
        b"bytes=0-",
        b"bytes=-1",
        b"bytes=5-2",
        b"bytes=" + b"0-0," * 2000,
        b"bytes=" + b"9" * 100,
        b"x=1",
    ):
        yield Hostile(f"Range {asked[:15]!r}", head("GET", "/docs", HOST, b"Range: " + asked), RANGE)
    kind = b"Content-Type: application/json"
    for length in (b"-1", b"9" * 30, b"0x10", b"1, 2", b"1 ", b"\xb2"):
        sent = head("POST", "/compare", HOST, kind, b"Content-Length: " + length) + b"{}"
        yield Hostile(f"Content-Length {length!r}", sent, refused_or_late)
    both = head("POST", "/compare", HOST, b"Content-Length: 2", CHUNKED) + b"0\r\n\r\n"
    yield Hostile("length and chunks", both, refused_or_late)
    huge = head("POST", "/query", HOST, CHUNKED) + b"FFFFFFFFFFFFFFFFF\r\nx"
    yield Hostile("huge chunk", huge, refused_or_late)
    for line in ODD_LINES:
        yield Hostile(f"{line[:24]!r}", head("GET", "/shapes", HOST, line), NAMED)
    for path in ODD_PATHS:
        yield Hostile(f"GET {path[:24]}", head("GET", path, HOST), NAMED)
    for body in ODD_BODIES:
        yield Hostile(f"JSON {body[:12]!r}", posted("/compare", body), REFUSED | {404})


def reads(shape: str) -> Iterator[Hostile]:
    """Yield requests that need no body, with a body that stops, is too large or is broken."""
    parts = ("similar", "file?format=stl", "thumbnail.png")
    for path in (*(f"/shapes/{shape}/{name}" for name in parts), "/duplicates", "/shapes"):
        alone = head("GET", path, HOST, b"Content-Length: 5")
        yield Hostile(f"GET {path[-13:]} without its body", alone, frozenset({200, 408}))
        large = head("GET", path, HOST, CHUNKED) + (b"10000\r\n" + b"x" * 65536 + b"\r\n") * 17
        yield Hostile(f"GET {path[-13:]} with a large body", large, frozenset({200, 413}))
        broken = head("GET", path, HOST, CHUNKED) + b"x\r\n"
        yield Hostile(f"GET {path[-13:]} with a broken chunk", broken, frozenset({400}))


def stalls(_shape: str) -> Iterator[Hostile]:
    """Yield requests that stop at every stage."""
    whole = form("/query", FILE)
    late = frozenset({408})
    body = whole.index(b"\r\n\r\n") + 4
    for name, end in {
        "head alone": body,
        "boundary": body + 2,
        "header of a part": body + 30,
        "head of a part": whole.index(b"\r\n\r\n", body) + 4,
        "file": len(whole) - 2000,
        "last boundary": len(whole) - 6,
        "last byte": len(whole) - 1,
    }.items():
        yield Hostile(f"stops in the {name}", whole[:end], late)
    large = form("/shapes", part(b"file", b"x" * 5 * MB, filename=b"a.off"))
    yield Hostile("stops on disk", large[: 3 * MB], late)
    chunked = head("POST", "/query", HOST, b"Content-Type: multipart/form-data; boundary=b", CHUNKED)
    for name, chunk in {"chunk": b"100\r\n--", "size of a chunk": b"10", "chunks": b"2\r\n--\r\n"}.items():
        yield Hostile(f"stops in the {name}", chunked + chunk, late)
    for kind in (b"application/json", b"text/plain"):
        yield Hostile(f"stops in {kind!r}", posted("/compare", b'{"first', kind, length=900), late | REFUSED)
