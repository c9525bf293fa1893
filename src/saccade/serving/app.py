"""The local server: receives photographs, processes requests one by one, stores nothing on disk.

A server on the loopback interface is reachable from every page in the user's browser, by
cross-origin requests (other Origin header) or DNS rebinding (other Host header). Both are rejected.
"""

import json
from asyncio import CancelledError
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from contextlib import asynccontextmanager
from threading import Event, Thread
from time import perf_counter
from typing import Any

import anyio
from anyio.to_thread import run_sync
from starlette.applications import Starlette
from starlette.datastructures import Headers, MutableHeaders
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.requests import ClientDisconnect, Request
from starlette.responses import HTMLResponse, PlainTextResponse, Response
from starlette.routing import Route
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from saccade.errors import SaccadeError
from saccade.serving.analysis import PhotoAnalyzer
from saccade.serving.playground import Playground
from saccade.viewing.page import as_json, html_page, json_element

WARM_UP = "saccade-warm-up"
"""Name of the thread that compiles the kernels."""
MAX_REQUEST_BYTES = 100_000
"""Maximum size of a request without a photograph, in bytes."""
UPLOAD_SECONDS = 60
"""Time limit of the body of a request, in seconds."""
CLIENT_CLOSED_REQUEST = 499
"""Status code for a client that has disconnected."""
HOST_NAMES = ("127.0.0.1", "localhost")
"""Host names of this machine in a local browser."""
SECURITY_HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}
"""Headers of every response, which prevent framing, reading and caching by other pages."""
LEAD = (
    "Saliency, scanpath and interest points of a photograph, and EKF-SLAM to try out. "
    "Everything stays on this machine, and nothing is stored."
)
STYLES = ("page.css", "report.css", "serving/serve.css")
SCRIPTS = (
    *("report.js", "photo.js", "image.js", "charts.js", "ground.js", "serving/controls.js"),
    *("serving/playground_view.js", "serving/playground.js", "serving/serve.js"),
)

Work = Callable[[Mapping[str, Any]], Mapping[str, Any]]
"""Function that computes the result of a request; both are JSON objects."""


def application(
    analyzer: PhotoAnalyzer,
    playground: Playground,
    samples: Mapping[str, bytes],
    port: int,
    max_bytes: int,
    controls: Mapping[str, Any],
) -> Starlette:
    """The server as an ASGI application.

    Args:
        analyzer: analyzes the photographs.
        playground: runs SLAM steps.
        samples: example photographs, JPEG files by name.
        port: port of this server; requests to other hosts are rejected.
        max_bytes: maximum size of a photograph.
        controls: settings of the page and their controls.
    """
    limiter, warmed_up = anyio.CapacityLimiter(1), Event()
    work: dict[str, Work] = {
        "look": analyzer.analyze,
        "points": analyzer.detect,
        "slam/start": playground.start,
        "slam/step": playground.step,
    }
    page = serve_page({**controls, "max_bytes": max_bytes, "samples": list(samples)})

    def warm_up() -> None:
        try:
            analyzer.warm_up()
            playground.warm_up()
        finally:
            warmed_up.set()

    @asynccontextmanager
    async def lifespan(_: Starlette) -> AsyncIterator[None]:
        Thread(target=warm_up, name=WARM_UP, daemon=True).start()
        yield

    async def front_page(_: Request) -> Response:
        return HTMLResponse(page)

    async def state(_: Request) -> Response:
        return _json_response({"warm": warmed_up.is_set()})

    async def sample(request: Request) -> Response:
        data = samples.get(request.path_params["name"])
        if data is None:
            raise HTTPException(404, "no such photograph")
        return Response(data, media_type="image/jpeg")

    async def photo(request: Request) -> Response:
        data = await _body(request, max_bytes)
        name = request.query_params.get("name", "photograph")
        return await _process(request, limiter, lambda: analyzer.open(data, name))

    def answer(compute: Work) -> Callable[[Request], Awaitable[Response]]:
        async def answered(request: Request) -> Response:
            table = await _json_body(request)
            return await _process(request, limiter, lambda: _timed(compute, table))

        return answered

    return Starlette(
        routes=[
            Route("/", front_page),
            Route("/state", state),
            Route("/samples/{name}", sample),
            Route("/photo", photo, methods=["POST"]),
            *(Route(f"/{path}", answer(each), methods=["POST"]) for path, each in work.items()),
        ],
        middleware=[Middleware(_Guard, port=port)],
        lifespan=lifespan,
    )


def serve_page(data: Mapping[str, Any]) -> str:
    """The page as a single HTML document.

    Args:
        data: the input of its script.
    """
    body = f'<div id="serve">{json_element(data)}</div>\n'
    body += "<noscript><p>This page needs JavaScript.</p></noscript>"
    sources = ("img-src 'self' data:", "connect-src 'self'")
    return html_page("saccade", LEAD, body, STYLES, SCRIPTS, sources=sources)


async def _process(
    request: Request, limiter: anyio.CapacityLimiter, work: Callable[[], Mapping[str, Any]]
) -> Response:
    """The result of `work`, skipped if the client has disconnected meanwhile."""
    try:
        async with limiter:
            if await request.is_disconnected():
                return Response(status_code=CLIENT_CLOSED_REQUEST)
            return _json_response(await run_sync(work))
    except KeyError as error:
        raise HTTPException(404, str(error.args[0])) from error
    except SaccadeError as error:
        raise HTTPException(422, str(error)) from error


def _timed(compute: Work, request: Mapping[str, Any]) -> dict[str, Any]:
    """The result of a request, and the milliseconds it took."""
    start = perf_counter()
    result = compute(request)
    return {**result, "ms": 1000 * (perf_counter() - start)}


class _Guard:
    """Rejects requests that do not come from the page itself, with status 403.

    Args:
        app: application for accepted requests.
        port: port of this server.
    """

    def __init__(self, app: ASGIApp, port: int) -> None:
        self._app = app
        self._hosts = {f"{name}:{port}" for name in HOST_NAMES}
        if port == 80:
            self._hosts.update(HOST_NAMES)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """An ASGI application."""
        app, has_started = self._app, False
        if scope["type"] == "http":
            reason = self._rejection(Headers(scope=scope), scope["method"])
            app = app if reason is None else PlainTextResponse(f"rejected: {reason}", 403)

        async def send_with_headers(message: Message) -> None:
            nonlocal has_started
            if message["type"] == "http.response.start":
                has_started = True
                MutableHeaders(scope=message).update(SECURITY_HEADERS)
            await send(message)

        try:
            await app(scope, receive, send_with_headers)
        except CancelledError:  # the server stops
            if scope["type"] != "http" or has_started:
                raise
            await PlainTextResponse("the server stops", 503)(scope, receive, send_with_headers)

    def _rejection(self, headers: Mapping[str, str], method: str) -> str | None:
        """Reason for the rejection of a request; None if accepted."""
        host, origin = headers.get("host", "").lower(), headers.get("origin")
        if host not in self._hosts:
            return "the Host header does not name this server"
        if "upgrade" in headers:
            return "expected HTTP, found an upgrade to another protocol"
        is_link = method == "GET" and headers.get("sec-fetch-mode") == "navigate"
        same_site = headers.get("sec-fetch-site", "none") in ("none", "same-origin")
        if (origin is None or origin.lower() == f"http://{host}") and (same_site or is_link):
            return None
        return "cross-origin request"


async def _body(request: Request, max_bytes: int) -> bytes:
    """The body of a request, limited in size and time, whatever length it declares."""
    body = bytearray()
    try:
        with anyio.fail_after(UPLOAD_SECONDS):
            async for chunk in request.stream():
                body += chunk
                if len(body) > max_bytes:
                    message = f"too large: expected at most {max_bytes / 1e6:g} MB"
                    raise HTTPException(413, message, {"Connection": "close"})
    except ClientDisconnect as error:
        raise HTTPException(CLIENT_CLOSED_REQUEST) from error
    except TimeoutError as error:
        message = f"too slow: expected the whole request within {UPLOAD_SECONDS} s"
        raise HTTPException(408, message, {"Connection": "close"}) from error
    return bytes(body)


async def _json_body(request: Request) -> dict[str, Any]:
    body = await _body(request, MAX_REQUEST_BYTES)
    try:
        value = json.loads(body)
    except (ValueError, RecursionError) as error:
        raise HTTPException(400, "expected JSON") from error
    if not isinstance(value, dict):
        raise HTTPException(400, "expected a JSON object")
    return value


def _json_response(data: Mapping[str, Any]) -> Response:
    return Response(as_json(data), media_type="application/json")
