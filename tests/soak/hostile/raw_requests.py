"""Hostile requests, as bytes: forms, headers and bodies that stop, whatever their file."""

from collections.abc import Iterator
from dataclasses import dataclass

from tests.service.support import small_file

HOST = b"Host: localhost\r\n"
MB = 1_000_000


@dataclass(frozen=True)
class Hostile:
    """A request.

    Attributes
    ----------
    name : str
    sent : bytes
        Everything that is sent; the connection then stays open.
    statuses : set of int
        The statuses of which its answer has one; an empty set means that there is no answer.
    """

    name: str
    sent: bytes
    statuses: frozenset[int]


def head(method: str, path: str, *lines: bytes) -> bytes:
    """Return the head of a request."""
    return f"{method} {path} HTTP/1.1\r\n".encode() + b"".join(line + b"\r\n" for line in lines) + b"\r\n"


def part(name: bytes, content: bytes, *, filename: bytes | None = None, more: bytes = b"") -> bytes:
    """Return a part of a form."""
    named = b"" if filename is None else b'; filename="' + filename + b'"'
    return (
        b'--b\r\nContent-Disposition: form-data; name="'
        + name
        + b'"'
        + named
        + more
        + b"\r\n\r\n"
        + content
        + b"\r\n"
    )


def form(path: str, *parts: bytes, parameters: bytes = b"; boundary=b", end: bytes = b"--b--\r\n") -> bytes:
    """Return a request with a form."""
    body = b"".join(parts) + end
    kind = b"Content-Type: multipart/form-data" + parameters
    return head("POST", path, HOST.strip(), kind, b"Content-Length: %d" % len(body)) + body


FILE = part(b"file", small_file(1), filename=b"a.off")
REFUSED = frozenset({400, 413, 415, 422})
TAKEN = REFUSED | {200, 201}
NAMED = frozenset({200, 400, 404, 422})
JSON = b"Content-Type: application/json"
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


def forms() -> Iterator[Hostile]:
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


def headers() -> Iterator[Hostile]:
    """Yield headers, paths and JSON that no client sends."""

    def get(*lines: bytes, path: str = "/shapes") -> bytes:
        return head("GET", path, HOST.strip(), *lines)

    def compare(*lines: bytes) -> bytes:
        return head("POST", "/compare", HOST.strip(), *lines)

    for origin in (b"http://[", b"http://]", b"//[", b"\xff", b"null", b"a" * 60_000, b"http://[::1"):
        sent = head("POST", "/shapes", HOST.strip(), b"Origin: " + origin)
        yield Hostile(f"Origin {origin[:9]!r}", sent, frozenset({400, 403}))
    rebound = b"rebound.example"
    wrong = frozenset({400, 421})
    for host in (b"", b"[", rebound, b"localhost." + rebound, b"\xff", b"@localhost", b"a" * 60_000):
        yield Hostile(f"Host {host[:9]!r}", head("GET", "/shapes", b"Host: " + host), wrong)
    yield Hostile("no Host", head("GET", "/shapes"), wrong)
    yield Hostile("two Hosts", get(b"Host: " + rebound), wrong)
    for asked in (b"0-", b"-1", b"5-2", b"0-0," * 2000, b"9" * 100):
        sent = get(b"Range: bytes=" + asked, path="/docs")
        yield Hostile(f"Range {asked[:9]!r}", sent, frozenset({200, 206, 416}))
    yield Hostile("Range of nothing", get(b"Range: x=1", path="/docs"), frozenset({200, 206, 416}))
    for length in (b"-1", b"9" * 30, b"0x10", b"1, 2", b"1 ", b"\xb2"):
        sent = compare(JSON, b"Content-Length: " + length) + b"{}"
        yield Hostile(f"Content-Length {length!r}", sent, REFUSED | {408})
    both = compare(b"Content-Length: 2", CHUNKED) + b"0\r\n\r\n"
    yield Hostile("length and chunks", both, REFUSED | {408})
    huge = head("POST", "/query", HOST.strip(), CHUNKED) + b"FFFFFFFFFFFFFFFFF\r\nx"
    yield Hostile("huge chunk", huge, REFUSED | {408})
    for line in (
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
    ):
        yield Hostile(f"{line[:24]!r}", get(line), NAMED)
    for query in (
        "?name=%ed%a0%80",
        "?cursor=%ff",
        "/%00",
        "?tag=%ud800",
        "/../healthz",
        "?" + "a=1&" * 3000,
    ):
        yield Hostile(f"GET {query[:24]}", get(path=f"/shapes{query}"), NAMED)
    for path in ("//shapes", "/shapes?limit=" + "9" * 5000):
        yield Hostile(f"GET {path[:24]}", get(path=path), NAMED)
    surrogates = b'{"first": "\\ud800", "second": "\\udfff"}'
    for body in (surrogates, b"[" * 100_000, b"\xff\xfe", b'"x"', b"9" * 5000):
        sent = compare(JSON, b"Content-Length: %d" % len(body)) + body
        yield Hostile(f"JSON {body[:12]!r}", sent, REFUSED | {404})


def reads(shape: str) -> Iterator[Hostile]:
    """Yield requests that need no body, with a body that stops, is too large or is broken."""
    paths = (
        f"/shapes/{shape}/similar",
        f"/shapes/{shape}/file?format=stl",
        f"/shapes/{shape}/thumbnail.png",
        "/duplicates",
        "/shapes",
    )
    for path in paths:
        alone = head("GET", path, HOST.strip(), b"Content-Length: 5")
        yield Hostile(f"GET {path[-13:]} without its body", alone, frozenset({200, 408}))
        large = head("GET", path, HOST.strip(), CHUNKED) + (b"10000\r\n" + b"x" * 65536 + b"\r\n") * 17
        yield Hostile(f"GET {path[-13:]} with a large body", large, frozenset({200, 413}))
        broken = head("GET", path, HOST.strip(), CHUNKED) + b"x\r\n"
        yield Hostile(f"GET {path[-13:]} with a broken chunk", broken, frozenset({400}))


def stalls() -> Iterator[Hostile]:
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
    chunked = head("POST", "/query", HOST.strip(), b"Content-Type: multipart/form-data; boundary=b", CHUNKED)
    for name, chunk in {"chunk": b"100\r\n--", "size of a chunk": b"10", "chunks": b"2\r\n--\r\n"}.items():
        yield Hostile(f"stops in the {name}", chunked + chunk, late)
    for kind in (b"application/json", b"text/plain"):
        sent = (
            head("POST", "/compare", HOST.strip(), b"Content-Type: " + kind, b"Content-Length: 900")
            + b'{"first'
        )
        yield Hostile(f"stops in {kind.decode()}", sent, late | REFUSED)
