"""Paths over a terrain: geometry, planning, readers and writers."""
