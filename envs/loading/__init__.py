"""``AORO/Loading-v0``: grasp a log that lies beside the machine, and put it on the bunk."""
