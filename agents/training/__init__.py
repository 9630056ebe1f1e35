"""Training: trainers, plans, checkpoints, curricula, searches of hyper-parameters."""
