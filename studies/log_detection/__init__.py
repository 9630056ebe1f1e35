"""A detector for logs that learns from made forests: how good it is, what of its pictures it needs, and what it saves.

``python -m studies.log_detection --help``
"""
