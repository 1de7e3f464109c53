"""Queries of a place: positions, relations and sightings of objects, free places; with typed answers."""
