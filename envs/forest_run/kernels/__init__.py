"""What past sweeps have shown around machines, on a device; everything else of a forest run are array operations."""
