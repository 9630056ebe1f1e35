"""AORO/Turning-v0: bring the articulated joint to a commanded angle."""
