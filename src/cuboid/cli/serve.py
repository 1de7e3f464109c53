"""`cuboid serve`: serve a scene, results or a store to browsers and programs, over HTTP."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from cuboid.cli.serving import add_address, listen, serve_app
from cuboid.cli.text_model import add_text_model, serving_model
from cuboid.ground.core.extras import need_cluster, need_serve

if TYPE_CHECKING:
    from starlette.applications import Starlette

    from cuboid.cli.serving import Address
    from cuboid.method.text_search import TextModel

EXAMPLE = "cuboid serve kitchen.cuboid"
PORT = 8765


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("place", metavar="SCENE|RESULTS|STORE", help="a scene file, a result folder, or a store")
    add_address(parser, PORT)
    add_text_model(parser)


def run(args: argparse.Namespace) -> int:
    """Serve until Ctrl-C."""
    from cuboid.services.queries.opening import is_place

    of_one = is_place(args.place)
    (need_serve if of_one else need_cluster)("cuboid serve")
    with listen(args.host, args.port, args.token) as address:
        app = _app(args.place, address, serving_model(args), of_one=of_one)
        return serve_app(app, address, f"{args.place} at {address.url}")


def _app(path: str, address: Address, model: TextModel | None, *, of_one: bool) -> Starlette:
    if of_one:
        from cuboid.services.queries.opening import open_place
        from cuboid.services.service.app import application as place_application

        return place_application(open_place(path, model), token=address.token, hosts=address.hosts)
    from cuboid.fleet.store.asgi import application as store_application

    return store_application(path, token=address.token, hosts=address.hosts, model=model)
