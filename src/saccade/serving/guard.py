"""What stands between the page of this machine and the rest of the world.

A server on the loopback is reached by every page that its user's browser has open: with a request
from elsewhere (its Origin is another), or by a name of another host that leads to 127.0.0.1 (its
Host is another). Neither gets in.
"""

from collections.abc import Mapping

from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import Request
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

LOOPBACK = "127.0.0.1"
NAMES = (LOOPBACK, "localhost", "[::1]")
"""Of this machine, as a browser on it writes them."""
KEPT_APART = {
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}
"""Headers of every answer: no other page frames, reads or keeps it."""


class TooLargeError(Exception):
    """More was sent than may be."""


class Guard:
    """Refuses what was not asked by the page itself, with 403 and one line.

    Args:
        app: what answers the rest.
        port: of this server.
        policy: the Content-Security-Policy of every answer.
    """

    def __init__(self, app: ASGIApp, port: int, policy: str) -> None:
        self._app = app
        self._hosts = {f"{name}:{port}" for name in NAMES}
        if port == 80:
            self._hosts.update(NAMES)
        self._headers = {**KEPT_APART, "Content-Security-Policy": policy}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """An ASGI application."""
        if scope["type"] != "http":
            if scope["type"] == "lifespan":
                await self._app(scope, receive, send)
            return

        async def send_apart(message: Message) -> None:
            if message["type"] == "http.response.start":
                MutableHeaders(scope=message).update(self._headers)
            await send(message)

        reason = self._reason(Headers(scope=scope), scope["method"])
        app = self._app if reason is None else PlainTextResponse(f"refused: {reason}\n", 403)
        await app(scope, receive, send_apart)

    def _reason(self, headers: Mapping[str, str], method: str) -> str | None:
        """Why a request is refused; None where it is not."""
        host = headers.get("host", "").lower()
        if host not in self._hosts:
            return "this server answers to its own name only"
        origin = headers.get("origin")
        if origin is not None and origin.lower() != f"http://{host}":
            return "another page asked"
        followed = method == "GET" and headers.get("sec-fetch-mode") == "navigate"
        if headers.get("sec-fetch-site", "none") not in ("none", "same-origin") and not followed:
            return "another page asked"
        return None


async def body_of(request: Request, most: int) -> bytes:
    """The body of a request, which is read no further than it may be long.

    Args:
        request: with or without a length.
        most: bytes.

    Raises:
        TooLargeError: it is longer, or says so.
    """
    said = request.headers.get("content-length", "")
    if said.isascii() and said.isdigit() and int(said[:20]) > most:
        raise TooLargeError
    body = bytearray()
    async for chunk in request.stream():
        body += chunk
        if len(body) > most:
            raise TooLargeError
    return bytes(body)
