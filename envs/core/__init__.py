"""What learning environments share: vector and single environments, the interface of a task, terms, pictures."""

from aoro_gym.execution.collection import paused_collection

with paused_collection():
    import aoro_gym.twin  # noqa: F401 (with Warp; all modules here need both)
