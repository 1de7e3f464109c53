"""Clusters of hot points become boxes that rest on their supporting plane (steps 8 and 10 of `docs/method.md`)."""
