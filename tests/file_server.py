"""A web server on 127.0.0.1 for tests of downloads, with ranges and typical failures."""

from __future__ import annotations

import re
import threading
from collections import Counter
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer


class FileServer:
    """A server of `files` by name.

    Attributes
    ----------
    files : content by name. ranges : whether the server supports ranges.
    drop_every : n; the connection is closed in the middle of every n-th answer (0: never).
    status : HTTP status of every answer; 0 is the normal status.
    gets, sent : numbers of GET requests and of sent body bytes, by name.
    """

    def __init__(self) -> None:
        self.files: dict[str, bytes] = {}
        self.ranges = True
        self.drop_every = 0
        self.status = 0
        self.gets: Counter[str] = Counter()
        self.sent: Counter[str] = Counter()
        self._lock = threading.Lock()
        owner = self

        class Handler(BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"

            def log_message(self, *words: object) -> None:
                """Log nothing."""

            def do_GET(self) -> None:
                name = self.path.rpartition("/")[2]
                drop = owner.count(name)
                data = owner.files.get(name)
                if data is None or owner.status:
                    return self.send(owner.status or 404, {}, b"")
                extra: dict[str, str] = {}
                status = 200
                requests = re.fullmatch(r"bytes=(\d*)-(\d*)", self.headers.get("Range", ""))
                if requests and owner.ranges:
                    first, last = requests.groups()
                    start = max(len(data) - int(last), 0) if first == "" else int(first)
                    stop = len(data) if first == "" or last == "" else min(int(last) + 1, len(data))
                    if start >= len(data):
                        return self.send(416, {}, b"")
                    extra["Content-Range"] = f"bytes {start}-{stop - 1}/{len(data)}"
                    status, data = 206, data[start:stop]
                self.send(status, extra, data, drop)
                return None

            def send(self, status: int, extra: dict[str, str], data: bytes, drop: bool = False) -> None:
                self.send_response(status)
                for name, value in {**extra, "Content-Length": str(len(data))}.items():
                    self.send_header(name, value)
                self.end_headers()
                sent = data[: (len(data) + 1) // 2] if drop else data
                # Count before sending: the test may read the counter as soon as it has the whole body.
                owner.sent[self.path.rpartition("/")[2]] += len(sent)
                self.wfile.write(sent)
                if drop:
                    self.close_connection = True

        class Quiet(ThreadingHTTPServer):
            daemon_threads = True

            def handle_error(self, *details: object) -> None:
                """Ignore lost connections, which are part of the tests."""

        self._server = Quiet(("127.0.0.1", 0), Handler)
        self.url = f"http://127.0.0.1:{self._server.server_address[1]}/"
        self._thread = threading.Thread(target=self._server.serve_forever, args=(0.01,), daemon=True)
        self._thread.start()

    def count(self, name: str) -> bool:
        """Count a GET request, and return whether its connection is closed early."""
        with self._lock:
            self.gets[name] += 1
            number = sum(self.gets.values())
            return bool(self.drop_every) and number % self.drop_every == 0

    def close(self) -> None:
        """Stop the server; later requests are refused."""
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()
