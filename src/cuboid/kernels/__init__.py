"""Hot loops on flat arrays; each is held against a readable NumPy truth by its test."""
