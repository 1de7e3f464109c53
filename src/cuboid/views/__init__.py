"""Pictures of what was found: labelled frames, overlays, and the videos made of them."""
