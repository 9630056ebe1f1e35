"""AORO/PathTracking-v0: drive along a path over rough ground."""
