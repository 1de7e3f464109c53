"""Many recordings: the store of their results, and batch runs that fill it."""
