"""Diagnosis of the gap between a machine and its twin."""
