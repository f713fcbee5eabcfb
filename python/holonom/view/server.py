"""A server for one page, on this machine alone, that ends with whoever started it."""

from __future__ import annotations

import secrets
import threading
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from urllib.parse import parse_qs, urlsplit

#: Answers of `Server`: the kind of content and the content; None where there is no such thing.
Answer = tuple[str, bytes] | None
#: Answers a request, by its path and the first value of each of its parameters.
Get = Callable[[str, dict[str, str]], Answer]
#: Takes what a page sends, by path, parameters and content; False refuses it.
Post = Callable[[str, dict[str, str], bytes], bool]
HTML, JSON = "text/html; charset=utf-8", "application/json"
#: Largest body of a request, bytes: a picture.
_MOST = 256 << 20


class Server:
    """Serves what functions return under an address that only its owner is told.

    Parameters
    ----------
    get : Get
    post : Post, optional
        Refuses everything by default.
    """

    def __init__(self, get: Get, post: Post = lambda *_: False) -> None:
        self._server = _Listener(get, post)
        work = threading.Thread(target=self._server.serve_forever, args=(0.1,), daemon=True)
        work.start()

    @property
    def address(self) -> str:
        """The address of the page."""
        return f"http://{self._server.host}{self._server.root}"

    def close(self) -> None:
        """End; open connections are cut."""
        self._server.shutdown()
        self._server.server_close()


class _Listener(ThreadingHTTPServer):
    """Holds what every request needs: the two functions and the address."""

    daemon_threads = True

    def __init__(self, get: Get, post: Post) -> None:
        super().__init__(("127.0.0.1", 0), _Handler)  # port 0 is one that the system finds free
        self.get, self.post = get, post
        self.root = f"/{secrets.token_urlsafe(12)}/"
        self.host = f"127.0.0.1:{self.server_port}"

    def handle_error(self, *_: object) -> None:
        """Say nothing: a browser that is closed cuts its connections."""


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    server: _Listener

    def do_GET(self) -> None:
        place = self._place()
        answer = self.server.get(*place) if place else None
        if answer is None:
            self._send(404, "text/plain", b"there is no such page")
        else:
            self._send(200, *answer)

    def do_POST(self) -> None:
        place = self._place()
        length = self.headers.get("Content-Length", "")
        if not place or not length.isdigit() or int(length) > _MOST:
            self.close_connection = True
            self._send(404, "text/plain", b"nothing is taken here")
            return
        taken = self.server.post(*place, self.rfile.read(int(length)))
        self._send(204 if taken else 410, "text/plain", b"")

    def _place(self) -> tuple[str, dict[str, str]] | None:
        """Path and parameters; None for whoever was not told the address."""
        parts = urlsplit(self.path)
        # Another name for this machine may come from a page of somebody else.
        host, root = self.server.host, self.server.root
        if self.headers.get("Host") != host or not parts.path.startswith(root):
            return None
        query = {name: values[0] for name, values in parse_qs(parts.query).items()}
        return parts.path[len(root) :], query

    def _send(self, status: int, kind: str, content: bytes) -> None:
        try:
            self.send_response(status)
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(content)))
            self.send_header("Cache-Control", "no-store")
            self.end_headers()
            self.wfile.write(content)
        except (BrokenPipeError, ConnectionResetError):
            self.close_connection = True

    def log_message(self, *_: object) -> None:
        """Say nothing: requests are no news."""
