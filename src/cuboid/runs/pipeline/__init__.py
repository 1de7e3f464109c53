"""Loops over whole recordings and streams: track, estimate poses, compile kernels in advance."""
