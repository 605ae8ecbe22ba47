"""Serves one page to browsers on this computer, and to no other.

Other users of this computer and pages of other sites can reach the port, too: the address has a random part that they
do not know, and whoever asks for anything else gets nothing.
"""

from __future__ import annotations

import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from irbcal.errors import IrbcalError

ADDRESS = "127.0.0.1"
PORT = 8160
"""Tried first, so that a tunnel's command stays the same."""

TOKEN_BYTES = 16
"""Of the random part of the address."""
READ_SECONDS = 10.0
"""After which a browser that says nothing is let go, so that none can hold the server's threads for ever."""

LOCAL_NAMES = ("127.0.0.1", "localhost")


@contextmanager
def serving(page: str, port: int | None = None) -> Iterator[str]:
    """A server of one page in a thread of its own.

    Parameters
    ----------
    page : str
        HTML.
    port : int, optional
        By default 8160, or any free one where that is taken; 0 for any.

    Yields
    ------
    str
        Address of the page, with a random part that is new each time.

    Raises
    ------
    IrbcalError
        If the port cannot be had.
    """
    from threading import Thread

    token = secrets.token_urlsafe(TOKEN_BYTES)
    server = _open(page.encode("utf-8"), token, port)
    thread = Thread(target=server.serve_forever, kwargs={"poll_interval": 0.1}, daemon=True)
    thread.start()
    try:
        yield f"http://{ADDRESS}:{server.server_port}/{token}/"
    finally:
        server.shutdown()
        server.server_close()


def _open(body: bytes, token: str, port: int | None) -> _Server:
    if port is None:
        try:
            return _Server((ADDRESS, PORT), _handler(body, token))
        except OSError:
            port = 0  # any free one
    try:
        return _Server((ADDRESS, port), _handler(body, token))
    except (OSError, OverflowError) as error:
        reason = getattr(error, "strerror", None) or error
        raise IrbcalError(f"port {port} of {ADDRESS} cannot be used: {reason}", parameter="port") from None


class _Server(ThreadingHTTPServer):
    daemon_threads = True
    allow_reuse_address = True

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A browser that went away is no error of ours."""


def _handler(body: bytes, token: str) -> type[BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        server_version, sys_version = "irbcal", ""
        timeout = READ_SECONDS
        expected = f"/{token}"

        def do_GET(self) -> None:
            """The page, to whoever asks for it under a local name (not through a foreign domain's DNS)."""
            host = self.headers.get("Host", "").rsplit(":", 1)[0].lower()
            if host not in LOCAL_NAMES:
                self.send_error(403)
            elif not secrets.compare_digest(self.path.partition("?")[0].rstrip("/").encode(), self.expected.encode()):
                self.send_error(404)
            else:
                self.send_response(200)
                self.send_header("Content-Type", "text/html; charset=utf-8")
                self.send_header("Content-Length", str(len(body)))
                self.send_header("Cache-Control", "no-store")
                self.send_header("X-Content-Type-Options", "nosniff")
                self.send_header("Referrer-Policy", "no-referrer")
                self.end_headers()
                self.wfile.write(body)

        def log_message(self, *arguments: Any) -> None:
            """No line for each request."""

    return Handler
