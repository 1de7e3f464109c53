"""Compilation of kernels: the decorator, the stamp of all that a kernel depends on, and the cache on disk."""
