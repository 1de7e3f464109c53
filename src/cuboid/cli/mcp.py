"""`cuboid mcp`: a scene or results for assistants, over the Model Context Protocol."""

from __future__ import annotations

import argparse
import sys

from cuboid.cli.serving import add_address, listen
from cuboid.cli.text_model import add_text_model, serving_model

EXAMPLE = "cuboid mcp kitchen.cuboid"
PORT = 8766


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("place", metavar="SCENE|RESULTS", help="a scene file or a result folder")
    parser.add_argument(
        "--http", action="store_true", help="serve over HTTP, at /mcp; else over standard input and output"
    )
    add_address(parser, PORT)
    add_text_model(parser)


def run(args: argparse.Namespace) -> int:
    """Serve until the assistant disconnects, or Ctrl-C."""
    from cuboid.core.errors import InputError
    from cuboid.core.extras import require
    from cuboid.core.threads import limit_threads
    from cuboid.queries.opening import is_place, open_place

    require("mcp", "cuboid mcp", "mcp")
    limit_threads(1)
    if not is_place(args.place):
        raise InputError(f"{args.place}: expected a scene file or a result folder")
    from cuboid.service.mcp import server_of

    server = server_of(open_place(args.place, serving_model(args)))
    if not args.http:
        print(f"cuboid: {args.place} over standard input and output", file=sys.stderr, flush=True)
        server.run("stdio")
        return 0
    import uvicorn

    from cuboid.service.mcp_http import application

    address = listen(args.host, args.port, args.token)
    try:
        url = address.url.replace("/?", "/mcp?") if address.token else f"{address.url}mcp"
        print(f"{args.place} at {url} (Ctrl-C ends it)", flush=True)
        app = application(server, token=address.token, hosts=address.hosts)
        config = uvicorn.Config(app, log_level="warning", server_header=False, access_log=False)
        uvicorn.Server(config).run(sockets=[address.listening])
    except KeyboardInterrupt:
        print("ended")
    finally:
        address.listening.close()
    return 0
