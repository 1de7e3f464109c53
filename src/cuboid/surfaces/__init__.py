"""Stage 5: supporting planes, and the clusters of hot points that stand on them."""
