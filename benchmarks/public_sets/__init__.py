"""The sets of real recordings as specifications of IdentiBench."""
