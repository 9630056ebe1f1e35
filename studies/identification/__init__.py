"""Which family of laws predicts turns that it was not fitted to."""
