"""``python -m aoro_gym`` is the command ``aoro-gym``."""

from aoro_gym.cli import main

if __name__ == "__main__":
    main()
