"""What garments are made of, as far as motion tells."""
