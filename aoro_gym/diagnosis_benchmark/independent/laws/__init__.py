"""Laws of the independent plants as device code: one function a law, one module a part of the machine."""
