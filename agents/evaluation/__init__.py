"""Evaluation: episodes, figures with intervals, leaderboard, reports."""
