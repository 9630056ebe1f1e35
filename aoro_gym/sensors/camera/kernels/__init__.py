"""Device code of cameras: one Warp source for the CPU and CUDA."""
