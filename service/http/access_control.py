"""Access control: admits a request or refuses it with a problem document, before its body is read."""

from starlette.datastructures import Headers
from starlette.types import ASGIApp, Receive, Scope, Send

from service.auth.gate import Gate
from service.errors import ServiceError
from service.http.problems import problem_of

# Keys of the request's scope: the digest of its API key, for the log, and its grant.
KEY_IN_SCOPE = "isoshape.key"
GRANT_IN_SCOPE = "isoshape.grant"
# The name of the collection that the request works in, once it is known.
COLLECTION_IN_SCOPE = "isoshape.collection"


class AccessControl:
    """Middleware that asks the gate about each request."""

    def __init__(self, app: ASGIApp, gate: Gate) -> None:
        self._app = app
        self._gate = gate

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        try:
            grant = self._gate.admit(scope["method"], scope["path"], headers)
        except ServiceError as error:
            await problem_of(error)(scope, receive, send)
            return
        scope[GRANT_IN_SCOPE] = grant
        if grant is not None and grant.digest is not None:
            scope[KEY_IN_SCOPE] = grant.digest
        await self._app(scope, receive, send)


def client_of(scope: Scope) -> str:
    """The client of an admitted request: the digest of its key, or its address where there are no keys."""
    digest, client = scope.get(KEY_IN_SCOPE), scope.get("client")
    return str(digest or (client[0] if client else ""))
