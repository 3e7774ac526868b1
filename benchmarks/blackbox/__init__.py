"""Physical models, peers and black boxes on the same held-out rows of real recordings."""
