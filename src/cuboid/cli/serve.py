"""`cuboid serve`: serve a store as pages and as a read-only API."""

from __future__ import annotations

import argparse
import os

from cuboid.cli.serving import port
from cuboid.cli.text_model import add_text_model, serving_model

EXAMPLE = "cuboid serve STORE"

# Where the token may be, so that it stands in no list of processes.
TOKEN = "CUBOID_TOKEN"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("store", metavar="STORE", help="the store of 'cuboid batch': a folder or URL")
    parser.add_argument(
        "--host", default="127.0.0.1", metavar="ADDRESS", help="address to listen at (default: this machine only)"
    )
    parser.add_argument(
        "--port", type=port, default=8765, metavar="N", help="port; 0 chooses a free one (default: 8765)"
    )
    parser.add_argument(
        "--token",
        metavar="TEXT",
        help=f"secret that each request must contain (default: ${TOKEN}, or a new one if other machines can connect)",
    )
    add_text_model(parser)


def run(args: argparse.Namespace) -> int:
    """Serve until Ctrl-C."""
    import secrets
    import socket

    from cuboid.core.extras import need_cluster

    need_cluster("cuboid serve")
    import uvicorn

    from cuboid.core.errors import OutputError
    from cuboid.store.asgi import application
    from cuboid.views.serving import LOCAL_NAMES

    alone = args.host in LOCAL_NAMES or args.host == "::1"
    token = args.token or os.environ.get(TOKEN) or (None if alone else secrets.token_urlsafe(16))
    hosts = (*LOCAL_NAMES, "[::1]") if alone else ("*",)  # who is reached under other names has a token
    app = application(args.store, token=token, hosts=hosts, model=serving_model(args))
    family = socket.AF_INET6 if ":" in args.host else socket.AF_INET
    listening = socket.socket(family)
    try:
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.bind((args.host, args.port))
        listening.listen()
    except OSError as error:
        listening.close()
        raise OutputError(f"{args.host} port {args.port} cannot be used: {error.strerror}") from error
    where = f"[{args.host}]" if family == socket.AF_INET6 else args.host
    secret = f"?token={token}" if token else ""
    print(f"{args.store} at http://{where}:{listening.getsockname()[1]}/{secret} (Ctrl-C ends it)", flush=True)
    server = uvicorn.Server(uvicorn.Config(app, log_level="warning", server_header=False, access_log=False))
    try:
        server.run(sockets=[listening])
    except KeyboardInterrupt:
        print("ended")
    return 0
