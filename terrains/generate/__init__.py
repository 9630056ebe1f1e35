"""Generated terrains: procedural forests, imperfect scans of them, and worlds of objects on any ground."""
