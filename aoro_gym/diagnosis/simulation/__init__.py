"""Simulated machines, days and logs that a diagnosis learns from; :mod:`.prior` says what they are drawn from."""
