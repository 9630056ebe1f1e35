"""The twin: rigid bodies, tires, hydraulics and engine of an articulated vehicle in one fused Warp kernel."""

from aoro_gym.execution.collection import paused_collection

with paused_collection():
    from aoro_gym.twin.twin import Trace, Twin

__all__ = ["Trace", "Twin"]
