"""The tree of sign choices, searched with a beam."""
