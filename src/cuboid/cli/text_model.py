"""`--text-model`: the image-text model of commands that embed objects or rank them by a text."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from cuboid.ground.core.errors import InputError

if TYPE_CHECKING:
    from cuboid.method.text_search import TextModel

MODEL = "folder with an image-text model (image.onnx, text.onnx, tokenizer.json)"


def add_embedding(parser: argparse._ActionsContainer) -> None:
    """Add `--text-model` of a run: the objects are embedded at its end."""
    what = f"at the end, embed pictures of the objects for searches by a text: {MODEL}"
    parser.add_argument("--text-model", metavar="DIR", help=what)


def add_text_model(parser: argparse._ActionsContainer) -> None:
    """Add `--text-model` of a command that ranks objects."""
    parser.add_argument("--text-model", metavar="DIR", help=f"{MODEL} (default: $CUBOID_TEXT_MODEL)")


def add_text(parser: argparse._ActionsContainer, *, required: bool = False) -> None:
    """Add `--text` and `--text-model`."""
    parser.add_argument(
        "--text",
        metavar="TEXT",
        required=required,
        help="rank objects by how well their pictures fit a text, such as 'something to drink from'",
    )
    add_text_model(parser)


def embedding_model(args: argparse.Namespace) -> TextModel | None:
    """Return the model that embeds the objects of a run, checked before the run; None without `--text-model`.

    Raises
    ------
    InputError
        There is no such model.
    """
    if args.text_model is None:
        return None
    from cuboid.method.text_search import TextModel

    model = TextModel(args.text_model)
    _ = model.preparation
    return model


def serving_model(args: argparse.Namespace) -> TextModel | None:
    """Return the model of a server, from the arguments or the environment; None without either."""
    import os

    from cuboid.method.text_search import MODEL_VARIABLE, open_text_model

    return open_text_model(args.text_model) if args.text_model or os.environ.get(MODEL_VARIABLE) else None


def ranking_model(args: argparse.Namespace) -> TextModel | None:
    """Return the model that ranks objects by `--text`; None without a text.

    Raises
    ------
    InputError
        There is no model, or a model is given without a text.
    """
    if args.text is None:
        if args.text_model is not None:
            raise InputError("--text-model needs --text")
        return None
    from cuboid.method.text_search import open_text_model

    return open_text_model(args.text_model)
