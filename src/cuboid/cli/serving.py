"""Options of the commands that open a page in the browser."""

from __future__ import annotations

import argparse
import os
import secrets
import socket
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

from cuboid.cli.parser import port
from cuboid.cli.tables import console
from cuboid.ground.core.errors import OutputError

if TYPE_CHECKING:
    from starlette.types import ASGIApp

    from cuboid.results.views.serving import PageServer


# This machine only.
HOST = "127.0.0.1"
# The environment variable with the token: the value of an option is visible in the list of processes.
TOKEN = "CUBOID_TOKEN"


def add_page(parser: argparse.ArgumentParser) -> None:
    """Add the options for the port and the browser."""
    parser.add_argument("--port", type=port, default=0, metavar="N", help="port of this machine (default: a free one)")
    parser.add_argument("--no-browser", action="store_true", help="print the address only, open no browser")


def serve(args: argparse.Namespace, what: str, page: PageServer) -> int:
    """Serve a page until Ctrl-C, and print its address; return the exit status."""
    import webbrowser

    with page as server:
        address = f"http://localhost:{server.server_port}/"
        console().print(f"{what} at {address} (Ctrl-C ends it)")
        if not args.no_browser:
            webbrowser.open(address)
        try:
            server.serve_forever()
        except KeyboardInterrupt:
            console().print("ended")
    return 0


def serve_app(app: ASGIApp, address: Address, said: str) -> int:
    """Serve an ASGI application until Ctrl-C; return the exit status."""
    import uvicorn

    print(f"{said} (Ctrl-C ends it)", flush=True)
    config = uvicorn.Config(app, log_level="warning", server_header=False, access_log=False)
    try:
        uvicorn.Server(config).run(sockets=[address.listening])
    except KeyboardInterrupt:
        print("ended")
    return 0


def add_address(parser: argparse.ArgumentParser, default_port: int) -> None:
    """Add the options for the address of a server, and for the secret in requests."""
    parser.add_argument(
        "--host", default=HOST, metavar="ADDRESS", help="address to listen at (default: this machine only)"
    )
    ports = f"port; 0 chooses a free one (default: {default_port})"
    parser.add_argument("--port", type=port, default=default_port, metavar="N", help=ports)
    parser.add_argument(
        "--token",
        metavar="TEXT",
        help=f"secret that each request must contain (default: ${TOKEN}, or a new one if other machines can connect)",
    )


@dataclass(frozen=True, slots=True)
class Address:
    """The address at which a server listens; a context manager, which closes it.

    Attributes
    ----------
    listening : socket.socket
    token : str or None
        Secret that requests must contain; None if only this machine can connect and no token was given.
    hosts : tuple of str
        Host names that requests may use.
    url : str
        With the token.
    """

    listening: socket.socket
    token: str | None
    hosts: tuple[str, ...]
    url: str

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.listening.close()


def listen(host: str, number: int, token: str | None) -> Address:
    """Listen at an address of this machine; if other machines can connect, there is always a token.

    Raises
    ------
    OutputError
        The address cannot be used.
    """
    from cuboid.results.views.serving import LOCAL_NAMES

    alone = host in LOCAL_NAMES or host == "::1"
    token = token or os.environ.get(TOKEN) or (None if alone else secrets.token_urlsafe(16))
    hosts = (*LOCAL_NAMES, "[::1]") if alone else ("*",)  # with other names, the token protects the server
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    # If the protocol is given, asyncio sends small answers at once (TCP_NODELAY); otherwise they wait 40 ms.
    listening = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    try:
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.bind((host, number))
        listening.listen()
    except OSError as error:
        listening.close()
        raise OutputError(f"{host} port {number} cannot be used: {error.strerror}") from error
    where = f"[{host}]" if family == socket.AF_INET6 else host
    secret = f"?token={token}" if token else ""
    return Address(listening, token, hosts, f"http://{where}:{listening.getsockname()[1]}/{secret}")
