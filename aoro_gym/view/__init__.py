"""The machine in the browser, live or from a log: solids, poses, a scene with its panel, and what moves them.

Only :mod:`aoro_gym.view.server` needs viser (``[view]``), which it imports when a server is started.
"""
