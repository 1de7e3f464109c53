"""What all stages share: frames, results, errors, configuration, and kernels of several stages."""
