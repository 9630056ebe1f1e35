"""The machine in the formats of other simulators."""
