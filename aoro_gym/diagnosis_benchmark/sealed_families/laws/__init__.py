"""Laws of the sealed families as device code: a module a family, and what they have in common."""
