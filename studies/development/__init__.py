"""Development plants: cases by the thousand that a diagnosis may be calibrated and tried on, and how well it does."""
