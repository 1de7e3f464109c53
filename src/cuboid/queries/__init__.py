"""Questions to a place: which objects are where, what is on what, what was seen last and when; and typed answers."""
