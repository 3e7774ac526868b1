"""Classical method: a beam search over the tree of sign choices."""
