"""Library of species: species files, templates and allometries, by way of ``formats``."""
