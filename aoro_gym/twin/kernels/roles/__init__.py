"""Four warps for 32 twins, on CUDA: who does what of a main step, and what they tell each other on a board."""

ROLES = 4
"""Warps of a block."""
TWINS = 32
"""Of a block, one a lane."""
BLOCK_DIM = ROLES * TWINS
"""Threads of a block."""
