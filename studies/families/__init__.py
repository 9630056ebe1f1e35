"""Families of laws beside one another: quick fits to the published figures."""
