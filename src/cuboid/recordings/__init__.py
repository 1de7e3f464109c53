"""Recordings as the user meets them: opened and registered, described, converted."""
