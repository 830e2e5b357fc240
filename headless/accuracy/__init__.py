"""``python -m headless accuracy``: error against seconds for each sensor of a scene, and what to set."""
