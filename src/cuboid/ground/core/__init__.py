"""The base package of all others: frames, errors, configuration, and kernels that several stages share."""
