"""Conversion of texts to token numbers by a ``tokenizer.json`` (the file of Hugging Face Tokenizers)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from cuboid.ground.core.errors import InputError, one_line
from cuboid.ground.core.extras import require
from cuboid.ground.formats.json_validation import read_any

TOKENIZER, TOKENIZER_CONFIG = "tokenizer.json", "tokenizer_config.json"
# Maximum length that counts as a limit: files without a limit contain a huge number.
MAX_TOKENS = 4096


class Tokens:
    """The tokenizer of a model; all texts get the same length, as in the training of CLIP and SigLIP.

    Parameters
    ----------
    folder : Path
        Folder with ``tokenizer.json``; ``tokenizer_config.json`` may give length and padding.
    length : int or None
        Length of the model's input; None if it accepts any.
    feature : str
        Option of the user that needs the model, for messages.

    Raises
    ------
    MissingExtraError
        The package tokenizers is not installed.
    InputError
        A file is missing or malformed.
    """

    def __init__(self, folder: Path, length: int | None, feature: str) -> None:
        tokenizers = require("tokenizers", feature, "names")
        path = folder / TOKENIZER
        if not path.is_file():
            raise InputError(f"{folder}: has no {TOKENIZER}")
        try:
            self._tokenizer: Any = tokenizers.Tokenizer.from_file(str(path))
        except Exception as error:  # the package has no error class
            raise InputError(f"{path}: is no tokenizer: {one_line(str(error))}") from None
        config = read_any(folder / TOKENIZER_CONFIG) if (folder / TOKENIZER_CONFIG).is_file() else {}
        padding, truncation = self._tokenizer.padding or {}, self._tokenizer.truncation or {}
        lengths = (length, truncation.get("max_length"), padding.get("length"), config.get("model_max_length"))
        self._length = next((int(n) for n in lengths if isinstance(n, (int, float)) and 0 < n <= MAX_TOKENS), None)
        if self._length is not None:
            pad = padding.get("pad_token") or _text_of(config.get("pad_token")) or ""
            number = self._tokenizer.token_to_id(pad)
            self._tokenizer.enable_truncation(self._length)
            self._tokenizer.enable_padding(length=self._length, pad_id=number or 0, pad_token=pad or "[PAD]")

    def of(self, text: str) -> tuple[list[int], list[int]]:
        """Return the token numbers of a text, and the mask: 1 for tokens, 0 for padding."""
        found = self._tokenizer.encode(text)
        return list(found.ids), list(found.attention_mask)


def _text_of(token: Any) -> str | None:
    """Return the text of a special token, which files store as text or as an object with the text."""
    if isinstance(token, dict):
        token = token.get("content")
    return token if isinstance(token, str) else None
