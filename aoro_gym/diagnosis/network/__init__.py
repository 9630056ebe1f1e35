"""The network that a diagnosis asks: what it is shown, how it is built, how it is trained."""
