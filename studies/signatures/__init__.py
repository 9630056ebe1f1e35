"""Signatures of every effect under every family of laws: how far one is like the other."""
