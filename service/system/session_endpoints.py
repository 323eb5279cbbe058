"""The address /session, where a page signs in and out."""

from typing import Literal

from fastapi import APIRouter, Request, Response
from pydantic import BaseModel, Field

from service.auth.gate import token_in
from service.auth.hosts import name_in
from service.auth.sessions import COOKIE, SECONDS
from service.dependencies import Service
from service.http.problems import documented

router = APIRouter(tags=["session"])


class Session(BaseModel):
    """The rights of this browser or program."""

    access: Literal["none", "read", "full"] = Field(
        description="Nothing; read, query and compare; or everything, as all may do where there are no keys."
    )
    signed_in: bool = Field(description="Whether a cookie says so, which signing out ends.")


@router.get("/session", summary="What may I do?", responses=documented("unauthorized"))
async def read_session(request: Request, container: Service) -> Session:
    """Answers without a key too: a page asks it whether to sign in first."""
    grant = container.gate.grant(request.headers)
    if grant is None:
        return Session(access="none", signed_in=False)
    return Session(access=grant.level, signed_in=grant.signed_in)


@router.post("/session", summary="Sign in")
async def begin_session(request: Request, response: Response, container: Service) -> Session:
    """Trade a key, in a header, for a cookie that the page's scripts cannot read; it lasts twelve hours."""
    grant = container.gate.grant(request.headers)
    assert grant is not None
    if grant.digest is None or grant.signed_in:
        return Session(access=grant.level, signed_in=grant.signed_in)
    response.set_cookie(
        COOKIE,
        container.gate.sessions.begin(grant, name_in(request.headers.get("host", ""))),
        max_age=SECONDS,
        httponly=True,
        samesite="strict",
        secure=request.url.scheme == "https",
    )
    return Session(access=grant.level, signed_in=True)


@router.delete("/session", status_code=204, summary="Sign out")
async def end_session(request: Request, response: Response, container: Service) -> None:
    """End the session, if there is one, and drop its cookie."""
    token = token_in(request.headers)
    if token is not None:
        container.gate.sessions.end(token)
    response.delete_cookie(COOKIE, httponly=True, samesite="strict", secure=request.url.scheme == "https")
