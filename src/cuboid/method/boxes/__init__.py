"""Stage 6: clusters of hot points become boxes that rest on their supporting plane."""
