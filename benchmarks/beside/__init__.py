"""The same job by others, to be timed or heard beside signid."""
