"""A request to a server of this machine."""

from __future__ import annotations

import http.client

from cuboid.results.views.serving import HOST


def asked(
    port: int, path: str, method: str = "GET", body: bytes | None = None, **headers: str
) -> tuple[int, str, bytes]:
    """Send a request, and return status, content type and content of the answer."""
    connection = http.client.HTTPConnection(HOST, port, timeout=20)
    connection.request(method, path, body, {name.replace("_", "-"): value for name, value in headers.items()})
    answer = connection.getresponse()
    content = answer.read()
    connection.close()
    return answer.status, answer.headers.get("Content-Type", ""), content
