"""`cuboid mcp`: a scene, results or a store for assistants, over the Model Context Protocol."""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING

from cuboid.cli.serving import add_address, listen, serve_app
from cuboid.cli.text_model import add_text_model, serving_model
from cuboid.ground.core.extras import need_cluster, require

if TYPE_CHECKING:
    from mcp.server.mcpserver import MCPServer

    from cuboid.method.text_search import TextModel

EXAMPLE = "cuboid mcp kitchen.cuboid"
MCP_PORT = 8766


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("place", metavar="SCENE|RESULTS|STORE", help="a scene file, a result folder, or a store")
    parser.add_argument(
        "--http", action="store_true", help="serve over HTTP, at /mcp; else over standard input and output"
    )
    add_address(parser, MCP_PORT)
    add_text_model(parser)


def run(args: argparse.Namespace) -> int:
    """Serve until the assistant disconnects, or Ctrl-C."""
    require("mcp", "cuboid mcp", "mcp")
    server = _server(args.place, serving_model(args))
    if not args.http:
        print(f"cuboid: {args.place} over standard input and output", file=sys.stderr, flush=True)
        server.run("stdio")
        return 0
    from cuboid.services.service.mcp import application

    with listen(args.host, args.port, args.token) as address:
        url = address.url.replace("/?", "/mcp?") if address.token else f"{address.url}mcp"
        app = application(server, token=address.token, hosts=address.hosts)
        return serve_app(app, address, f"{args.place} at {url}")


def _server(path: str, model: TextModel | None) -> MCPServer:
    """Return the MCP server of a scene, of results, or of a store."""
    from cuboid.services.queries.opening import is_place, open_place

    if is_place(path):
        from cuboid.services.service.mcp import server_of as server_of_place

        return server_of_place(open_place(path, model))
    need_cluster("cuboid mcp STORE")
    from cuboid.fleet.store.mcp import server_of as server_of_store

    return server_of_store(path, model)
