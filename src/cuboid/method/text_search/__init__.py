"""Open vocabulary: objects ranked by a text, through an image-text model such as CLIP or SigLIP."""

from __future__ import annotations

from cuboid.method.text_search.embeddings import Embeddings, TextMatch, ranked
from cuboid.method.text_search.model import MODEL_VARIABLE, TextModel, TextQuery, open_text_model
from cuboid.method.text_search.pictures import embed_views, mean_vector

__all__ = [
    "MODEL_VARIABLE",
    "Embeddings",
    "TextMatch",
    "TextModel",
    "TextQuery",
    "embed_views",
    "mean_vector",
    "open_text_model",
    "ranked",
]
