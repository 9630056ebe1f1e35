"""Simulated manoeuvres: commands, recordings of the twin, logs, and key figures of full turns."""
