"""A vehicle in the loop: its driveline on dynamometers or in another process, its bodies, tires and steering in the twin."""
