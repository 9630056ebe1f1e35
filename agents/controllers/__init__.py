"""Reference controllers, and how they are tuned."""
