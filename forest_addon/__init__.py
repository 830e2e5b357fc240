"""Forest Sensing: grows L-system forests and runs biosonar, LiDAR and forest reverb in them."""
