"""A scene that lasts: one file a place, with its map, its objects and their labels, opened again and gone on with."""
