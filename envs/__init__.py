"""Learning environments over a twin. None is written yet: this package only holds their place."""
