"""Generated terrains: procedural forests, and imperfect scans of them."""
