"""Plants: machines whose laws share no code with the twin, to check a diagnosis on."""
