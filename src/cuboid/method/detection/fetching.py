"""Download of models from their publishers: resumed after an interruption, and verified by a checksum."""

from __future__ import annotations

import hashlib
import http.client
import urllib.error
import urllib.request
from collections.abc import Callable
from pathlib import Path

from cuboid.ground.core.errors import InputError, OutputError
from cuboid.method.detection.models import Model

# Timeout of a server's answer, seconds.
FETCH_TIMEOUT_S = 30.0
PART_BYTES = 1 << 18


def fetch(model: Model, on_progress: Callable[[int, int], None] = lambda done, total: None) -> Path:
    """Download a model, or the rest of it, into the folder of models; return its path.

    Parameters
    ----------
    model : Model
    on_progress : callable
        Called repeatedly with the number of bytes so far and the total.

    Raises
    ------
    InputError
        The download fails, or its checksum is not the publisher's.
    OutputError
        The file cannot be written.
    """
    path = model.path
    if model.kept and _digest(path) == model.sha256:
        return path
    partial = path.with_name(f"{path.name}.partial")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        _download(model, partial, on_progress)
        found = _digest(partial)
        if found != model.sha256:
            partial.unlink()
            raise InputError(
                f"{model.url}: is not the file that was published: its sha256 is {found}, expected {model.sha256}"
            )
        partial.replace(path)
    except (urllib.error.URLError, http.client.HTTPException, TimeoutError, ConnectionError, ValueError) as error:
        reason = getattr(error, "reason", None) or error
        raise InputError(f"{model.url}: cannot be fetched: {reason}; the same call goes on from there") from None
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror or error}") from None
    return path


def _download(model: Model, partial: Path, on_progress: Callable[[int, int], None]) -> None:
    done = partial.stat().st_size if partial.is_file() else 0
    if done > model.size_bytes:
        done = 0
    if done == model.size_bytes:
        return
    request = urllib.request.Request(model.url, headers={"Range": f"bytes={done}-"} if done else {})
    with urllib.request.urlopen(request, timeout=FETCH_TIMEOUT_S) as answer:
        goes_on = answer.status == http.client.PARTIAL_CONTENT and done > 0
        done = done if goes_on else 0
        with partial.open("ab" if goes_on else "wb") as file:
            while part := answer.read(PART_BYTES):
                done += len(part)
                if done > model.size_bytes:
                    break  # another file: its checksum will not match
                file.write(part)
                on_progress(done, model.size_bytes)
    if done < model.size_bytes:
        raise ConnectionError(f"{done} of {model.size_bytes} bytes came")


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
