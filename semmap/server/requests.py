"""What requests say: their map, the role of their token, and a body with its files."""

from __future__ import annotations

import asyncio
import hmac
import re
from collections.abc import Mapping
from email import message_from_bytes, message_from_string
from pathlib import Path
from urllib.parse import unquote

from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.types import ASGIApp, Receive, Scope, Send

_SLASH = "\x1f"

MOST_FILES = 100  # of a request

SECONDS_TO_SEND = 20
"""Seconds that a client has to send the head of a request, and then its body."""


class EncodedSlashes:
    """Keeps the slashes in names (``%2F``) apart from those between them; `map_of` has them."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, as ASGI has it."""
        raw = scope.get("raw_path") or b""
        if b"%2F" in raw.upper():
            path = re.sub("%2F", _SLASH, raw.decode("latin-1"), flags=re.IGNORECASE)
            scope = dict(scope, path=unquote(path))
        await self._app(scope, receive, send)


def map_of(request: Request) -> str:
    """The name of the map in the path of a request."""
    return str(request.path_params["map"]).replace(_SLASH, "/")


def client_of(request: Request) -> str:
    """The client of a request: its token, else its address."""
    address = request.client.host if request.client else ""
    return request.headers.get("authorization", address)


def files_of(kind: str, body: bytes) -> list[tuple[str, bytes]]:
    """The media types and contents of a body, which may have several files (RFC 2046)."""
    if not kind.startswith("multipart/"):
        return [(kind, body)]
    boundary = message_from_string(f"Content-Type: {kind}\n\n").get_boundary() or ""
    _, *parts = (b"\r\n" + body).split(b"\r\n--" + boundary.encode("latin-1"))
    if not boundary or len(parts) < 2 or not parts[-1].startswith(b"--"):
        raise HTTPException(400, "the request has no parts that can be read")
    if len(parts) > MOST_FILES:
        raise HTTPException(400, f"the request has more than {MOST_FILES} files")
    split = (part.partition(b"\r\n\r\n") for part in parts[:-1])
    return [
        (message_from_bytes(head.lstrip() + b"\r\n\r\n")["content-type"] or "", content)
        for head, _, content in split
    ]


def address_of(request: Request) -> str:
    """The address of a request as it was sent, without its query."""
    return str(request.url.replace(path=request.scope["raw_path"].decode("ascii"), query=""))


async def body_of(request: Request, most_bytes: int) -> bytes:
    """The body of a request; HTTPException if it is larger than `most_bytes`, or comes late."""
    body = bytearray()
    try:
        async with asyncio.timeout(SECONDS_TO_SEND):
            async for part in request.stream():
                body += part
                if len(body) > most_bytes:
                    raise HTTPException(413, f"the request has more than {most_bytes:,} bytes")
    except TimeoutError:
        raise HTTPException(408, f"the request took more than {SECONDS_TO_SEND} s") from None
    return bytes(body)


def role_of(authorization: str | None, tokens: Mapping[str, str]) -> str | None:
    """The role of a header ``Bearer TOKEN``; None without one.

    PermissionError if the token is not known.
    """
    if authorization is None:
        return None
    scheme, _, token = authorization.partition(" ")
    if scheme.lower() == "bearer":
        for known, role in tokens.items():
            if hmac.compare_digest(known.encode(), token.strip().encode()):
                return role
    raise PermissionError("the token is not known")


def read_tokens(path: Path) -> dict[str, str]:
    """The roles of tokens: a file with a token and a role in each line."""
    if path.stat().st_mode & 0o077:
        raise ValueError(f"{path}: others can read it: chmod 600 {path}")
    tokens = {}
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
        words = line.split()
        if not words or words[0].startswith("#"):
            continue
        if len(words) != 2 or len(words[0]) < 16:
            raise ValueError(
                f"{path}, line {number}: give a token of at least 16 characters and a role"
            )
        tokens[words[0]] = words[1]
    return tokens
