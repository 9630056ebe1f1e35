"""The twin in the loop with real parts: exported binaries, a server on sockets, a vehicle on dynamometers, a CAN bus."""
