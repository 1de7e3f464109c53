"""The ground, which every other package may use: geometry, frames, errors, kernels, file formats, messages."""
