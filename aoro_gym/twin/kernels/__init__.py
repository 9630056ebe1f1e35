"""The kernels: ``reset`` puts twins at rest, ``advance`` moves them; ``build`` makes both for one kind of ground."""
