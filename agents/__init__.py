"""Agents that drive the twin, learned and classical. None is written yet: this package only holds their place."""
