"""Who serves the pages of the app: on this computer only, to who knows the token.

Other users of this computer and pages of other sites can reach the port, too. The first call has the token in its
address; a cookie of this site holds it from then on. Foreign host names (a site that points its name at this
computer) and foreign origins get nothing, of pages and of the connection that keeps them alive.
"""

from __future__ import annotations

import contextlib
import os
import secrets
import socket
from collections.abc import Awaitable, Callable, Mapping, MutableMapping
from http.cookies import SimpleCookie
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

from irbcal.app.project import Project
from irbcal.errors import IrbcalError

ADDRESS = "127.0.0.1"
PORT = 8170
LOCAL_NAMES = ("127.0.0.1", "localhost")
TOKEN_BYTES = 16
COOKIE = "irbcal"

Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]
Application = Callable[[Scope, Receive, Send], Awaitable[None]]


class Guard:
    """An ASGI application that lets through to another what comes from this computer with the token.

    Parameters
    ----------
    application : callable
    token : str
    port : int
    """

    def __init__(self, application: Application, token: str, port: int) -> None:
        self.application, self.token, self.cookie = application, token, f"{COOKIE}-{port}"

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve, or refuse with 403."""
        if scope["type"] not in ("http", "websocket"):
            await self.application(scope, receive, send)
            return
        headers = {name.decode("latin-1"): value.decode("latin-1") for name, value in scope["headers"]}
        query = parse_qs(scope["query_string"].decode("latin-1"))
        if self.local(headers) and self._known(SimpleCookie(headers.get("cookie", "")).get(self.cookie)):
            await self.application(scope, receive, send)
        elif self.local(headers) and scope["type"] == "http" and self._same(query.get("token", [""])[0]):
            cookie = f"{self.cookie}={self.token}; HttpOnly; SameSite=Strict; Path=/"
            await _answer(send, 303, [(b"location", b"/"), (b"set-cookie", cookie.encode())])
        elif scope["type"] == "http":
            await _answer(send, 403, [], b"Open the address that irbcal app printed: it has the token.")
        else:
            await send({"type": "websocket.close", "code": 1008})

    @staticmethod
    def local(headers: Mapping[str, str]) -> bool:
        """Whether host and origin are this computer's."""
        origin = headers.get("origin")
        hosts = [
            headers.get("host", "").rsplit(":", 1)[0],
            *([] if origin is None else [urlsplit(origin).hostname or ""]),
        ]
        return all(host.lower() in LOCAL_NAMES for host in hosts)

    def _known(self, cookie: Any) -> bool:
        return cookie is not None and self._same(cookie.value)

    def _same(self, token: str) -> bool:
        return secrets.compare_digest(token.encode(), self.token.encode())


async def _answer(send: Send, status: int, headers: list[tuple[bytes, bytes]], body: bytes = b"") -> None:
    plain = (b"content-type", b"text/plain; charset=utf-8")
    await send({"type": "http.response.start", "status": status, "headers": [plain, *headers]})
    await send({"type": "http.response.body", "body": body})


def free_socket(port: int | None) -> socket.socket:
    """A socket that listens on this computer.

    Parameters
    ----------
    port : int, optional
        By default 8170, or any free one where that is taken; 0 for any.

    Raises
    ------
    IrbcalError
        If the port cannot be had.
    """
    listening = socket.socket()
    if os.name == "posix":  # elsewhere it would let two servers share a port
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((ADDRESS, PORT if port is None else port))
    except (OSError, OverflowError) as error:
        listening.close()
        if port is None:
            return free_socket(0)
        reason = getattr(error, "strerror", None) or error
        raise IrbcalError(f"port {port} of {ADDRESS} cannot be used: {reason}", parameter="port") from None
    return listening


def serve(folder: Path, port: int | None, ready: Callable[[str], object]) -> None:
    """Serve the app of a project until it is stopped.

    Parameters
    ----------
    folder : Path
        The project's, made where it is not there.
    port : int, optional
        See `free_socket`.
    ready : callable
        Called with the address, once the pages can be opened.

    Raises
    ------
    IrbcalError
        If the folder is no project's, or the port cannot be had.
    """
    import uvicorn
    from fastapi import FastAPI
    from nicegui import ui

    from irbcal.app import pages

    project = Project.open(folder)
    listening = free_socket(port)
    number, token = listening.getsockname()[1], secrets.token_urlsafe(TOKEN_BYTES)
    application = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)
    pages.build(application, project)
    ui.run_with(
        application, title="irbcal", favicon="🦾", dark=None, show_welcome_message=False, reconnect_timeout=30.0
    )
    settings = uvicorn.Config(
        Guard(application, token, number),
        log_level="warning",
        lifespan="on",
        ws_max_size=1 << 26,
        timeout_graceful_shutdown=2,
    )

    class Server(uvicorn.Server):
        async def startup(self, sockets: list[socket.socket] | None = None) -> None:
            await super().startup(sockets)
            ready(f"http://{ADDRESS}:{number}/?token={token}")

    with contextlib.suppress(KeyboardInterrupt):
        Server(settings).run(sockets=[listening])
