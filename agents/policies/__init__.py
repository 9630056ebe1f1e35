"""Learned policies as files, and those that are shipped."""
