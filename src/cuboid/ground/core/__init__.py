"""Types and kernels that all stages share: frames, results, errors, configuration."""
