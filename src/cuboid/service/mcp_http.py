"""MCP over HTTP (the streamable one), with the guard of all servers of ours."""

from __future__ import annotations

from mcp.server.mcpserver import MCPServer
from mcp.server.transport_security import TransportSecuritySettings
from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.middleware.trustedhost import TrustedHostMiddleware

from cuboid.views.guard import Guard

METHODS = ("GET", "HEAD", "POST", "DELETE")


def application(server: MCPServer, *, token: str | None, hosts: tuple[str, ...]) -> Starlette:
    """Return the ASGI application, which answers at /mcp.

    Parameters
    ----------
    server : MCPServer
    token : str or None
        Token that a request must contain; with None every request is answered.
    hosts : tuple of str
        Names under which it is answered; ``*`` for any.
    """
    # Names and origins are checked here, as in the other servers.
    checked_here = TransportSecuritySettings(enable_dns_rebinding_protection=False)
    app = server.streamable_http_app(json_response=True, stateless_http=True, transport_security=checked_here)
    app.user_middleware += [
        Middleware(Guard, token=token, methods=METHODS),
        Middleware(TrustedHostMiddleware, allowed_hosts=list(hosts)),
    ]
    return app
