"""What the kernels of all tasks share: the memory of a step with its beginning and end, and the measured joint."""
