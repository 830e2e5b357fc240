"""Training on our plots, tested on real clouds: what a network for forests gains and lacks."""
