"""``AORO/Levelling-v0``: keep the frames level and the wheels' loads even over rough ground, by the four pendulum arms."""
