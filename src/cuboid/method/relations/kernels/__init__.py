"""Hot loops of this package on flat arrays; each is compared with a readable NumPy version by its test."""
