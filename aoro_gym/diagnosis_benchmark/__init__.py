"""The benchmark of the diagnosis: plants of other laws, sealed cases, runs and scores."""
