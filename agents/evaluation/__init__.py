"""Evaluation: episodes, metrics with intervals, leaderboard, reports."""
