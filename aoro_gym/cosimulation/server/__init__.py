"""A twin on sockets: its sensors as records and GPS sentences, its valves commanded in volts."""
