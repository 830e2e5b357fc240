"""Read: the evaluated scene and painted inputs as arrays."""
