"""How near the twin is: figures of all machine files that were fitted, and the page docs/validation.md made of them."""
