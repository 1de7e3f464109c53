"""Pictures of results: labelled frames, overlays, and videos of both."""
