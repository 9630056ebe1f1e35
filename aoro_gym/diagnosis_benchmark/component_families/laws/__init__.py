"""Laws of the component families as device code: a module a family, and what they have in common."""
