"""Forest reverb: what trunks do to sound between sources and receivers."""
