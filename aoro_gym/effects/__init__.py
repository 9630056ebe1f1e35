"""The catalogue of effects: deviations of a machine from its twin, each off by default."""
