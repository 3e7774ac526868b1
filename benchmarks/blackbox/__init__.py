"""Physical models, peers and black boxes on the same rows of real recordings that took no part in any fit."""
