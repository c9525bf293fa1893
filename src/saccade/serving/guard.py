"""Protection of the local server from other pages of the same browser.

A server on the loopback interface can be reached by every page that its user has open: by a
cross-origin request, which has another Origin, or by DNS rebinding, with another Host.
"""

from collections.abc import Mapping

from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import Request
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

HOST_NAMES = ("127.0.0.1", "localhost", "[::1]")
"""Of this machine, as a browser on it writes them."""
SECURITY_HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}
"""Headers of every response: no other page frames, reads or keeps it."""


class TooLargeError(Exception):
    """A request body exceeds its limit."""


class Guard:
    """Rejects requests that do not come from the page itself, with 403 and one line.

    Args:
        app: answers the others.
        port: of this server.
        policy: the Content-Security-Policy of every response.
    """

    def __init__(self, app: ASGIApp, port: int, policy: str) -> None:
        self._app = app
        self._hosts = {f"{name}:{port}" for name in HOST_NAMES}
        if port == 80:
            self._hosts.update(HOST_NAMES)
        self._headers = {**SECURITY_HEADERS, "Content-Security-Policy": policy}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """An ASGI application."""
        if scope["type"] != "http":
            if scope["type"] == "lifespan":
                await self._app(scope, receive, send)
            return

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                MutableHeaders(scope=message).update(self._headers)
            await send(message)

        reason = self._rejection(Headers(scope=scope), scope["method"])
        app = self._app if reason is None else PlainTextResponse(f"refused: {reason}\n", 403)
        await app(scope, receive, send_with_headers)

    def _rejection(self, headers: Mapping[str, str], method: str) -> str | None:
        """Why a request is rejected; None where it is not."""
        host, origin = headers.get("host", "").lower(), headers.get("origin")
        if host not in self._hosts:
            return "this server answers to its own name only"
        is_link = method == "GET" and headers.get("sec-fetch-mode") == "navigate"
        same_site = headers.get("sec-fetch-site", "none") in ("none", "same-origin")
        if (origin is None or origin.lower() == f"http://{host}") and (same_site or is_link):
            return None
        return "another page asked"


async def read_body(request: Request, max_bytes: int) -> bytes:
    """The body of a request, with or without a declared length.

    Raises:
        TooLargeError: it is longer than `max_bytes`, or declared so.
    """
    length = request.headers.get("content-length", "")
    if length.isascii() and length.isdigit() and int(length[:20]) > max_bytes:
        raise TooLargeError
    body = bytearray()
    async for chunk in request.stream():
        body += chunk
        if len(body) > max_bytes:
            raise TooLargeError
    return bytes(body)
