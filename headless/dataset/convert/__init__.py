"""A made dataset in the formats that people train with; ``FORMATS`` names them."""
