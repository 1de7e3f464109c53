"""From recordings and cameras to frames."""
