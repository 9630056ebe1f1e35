"""``AORO/PathTracking-v1``: path tracking at the limits of steering, grip and reception."""
