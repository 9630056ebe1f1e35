"""What a machine's logger wrote: tables of any dialect, names with units, logs."""
