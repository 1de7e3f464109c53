"""The ground that all packages stand on: frames, errors, configuration, kernels that several stages share."""
