"""What long work needs whatever it computes: files written whole, locked folders, digests, and results kept on disk."""
