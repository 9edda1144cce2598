"""Serves the metrics of a live or recorded system to a Prometheus on this computer.

There is one page, served by one thread, on the loopback address only.
"""

import select
from http.server import BaseHTTPRequestHandler, HTTPServer
from typing import Any

from heronry_tools.console.errors import UserError
from heronry_tools.watch.metrics import CONTENT_TYPE, exposition
from heronry_tools.watch.top.sources import TopSource
from heronry_wire.interruption import noted

_LOOK_S = 0.1


def serve(source: TopSource, port: int) -> None:
    """Serve the metrics of `source` until SIGINT or SIGTERM.

    Raises UserError if the port cannot be used.
    """
    stopped = noted()
    try:
        server = HTTPServer(("127.0.0.1", port), _page(source))
    except (OSError, OverflowError) as error:
        raise UserError(f"port {port} cannot be used ({error}): name another one with --port") from error
    with server:
        print(f"http://127.0.0.1:{server.server_port}/metrics", flush=True)
        while not stopped:
            ready, _, _ = select.select([server, *source.readers()], [], [], _LOOK_S)
            source.look()
            if server in ready:
                server.handle_request()


def _page(source: TopSource) -> type[BaseHTTPRequestHandler]:
    class Page(BaseHTTPRequestHandler):
        """The page of metrics."""

        timeout = 1.0  # seconds until a caller that sends no request is dropped, so that other callers are answered

        def do_GET(self) -> None:
            """Answer with the present metrics."""
            is_it = self.path.partition("?")[0] == "/metrics"
            body = exposition(source.snapshot()) if is_it else b"the metrics are at /metrics\n"
            self.send_response(200 if is_it else 404)
            self.send_header("Content-Type", CONTENT_TYPE if is_it else "text/plain; charset=utf-8")
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, *_: Any) -> None:
            """Log no requests: this replaces the method that would write a line for each request."""

    return Page
