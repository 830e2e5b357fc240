"""The commands of ``python -m headless``, a file each."""
